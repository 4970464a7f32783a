"""Step 0 of a run: the program, random agents, pi_B's healthy experience, and students that start from pi_B."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour, registry
from srl_jax.blocks import blocked_map
from srl_jax.config import Config
from srl_jax.env import hexapod
from srl_jax.job import plan
from srl_jax.job.teachers import Behaviour
from srl_jax.program import replay as replays
from srl_jax.program import tally as tallies
from srl_jax.program.engine import Engine, lane_data, lane_mesh
from srl_jax.program.lanes import Layout
from srl_jax.program.randomness import lane_keys
from srl_jax.program.state import COLLECT, LaneData, Program, TrainState, bind_teachers, on_all, on_rows, rows_sharding
from srl_jax.types import Transition

CLONE_NOISE = 0.25  # on pi_B's actions while its healthy experience is collected, so that a clone sees its own errors


def make_program(config: Config, layout: Layout, teachers: Sequence[Behaviour]) -> Program:
    """The static parts of a run's one program, on the first `layout.devices` devices."""
    mesh = lane_mesh(layout)
    return Program(
        agents={algo: registry.agent(config.agent(algo)) for algo in layout.algos},
        layout=layout,
        robot=hexapod.make(config.task, config.env, teachers[0].clock_hz, config.anatomy),
        teachers=tuple(teacher.apply for teacher in teachers),
        settings=config.train,
        mesh=mesh,
        wide=mesh.devices.flat[0].platform != "cpu",
        mix=plan.parse_mix(config),
    )


def make_lanes(
    program: Program, config: Config, teachers: Sequence[Behaviour], stream: str, damages: Sequence[str]
) -> LaneData:
    """The rows' constants; see `engine.lane_data`."""
    settings = {algo: config.agent(algo) for algo in program.layout.algos}
    return lane_data(program, settings, [teacher.params for teacher in teachers], stream, damages)


def init_agents(program: Program, lanes: LaneData) -> dict[str, Any]:
    """Every row's agent before it has learned anything."""
    agents = {}
    for algo in program.layout.algos:

        def init(key: jax.Array, params: tuple, algo=algo):
            teachers = bind_teachers(program, algo, params)
            return program.agents[algo].init(key, program.observation_size, program.action_size, teachers=teachers)

        index = program.layout.rows_of[algo]
        teachers = jax.tree.map(lambda x, index=index: x[index], lanes.teachers)
        keys = on_rows(program, lane_keys(program.layout.of(algo), "agent"))
        agents[algo] = jax.jit(jax.vmap(init), out_shardings=rows_sharding(program))(keys, teachers)
    return agents


def init_state(engine: Engine, lanes: LaneData) -> TrainState:
    """Everything at step 0: random agents, empty replays, robots at the start of an episode."""
    program = engine.program
    sizes, settings = program.sizes, program.settings
    room = partial(replays.init, settings.capacity, settings.environments, sizes)
    counts = {a: len(program.layout.rows_of[a]) for a, agent in program.agents.items() if agent.replays}
    empty = jax.jit(
        lambda: {algo: jax.vmap(lambda _: room())(jnp.arange(count)) for algo, count in counts.items()},
        out_shardings=rows_sharding(program),
    )
    return TrainState(
        clock=on_all(program, jnp.zeros((), jnp.int32)),
        agents=init_agents(program, lanes),
        replay=empty(),
        world=engine.new_world(lanes),
        alive=on_rows(program, np.ones(len(program.layout.rows), bool)),
    )


def from_behaviour(
    engine: Engine, state: TrainState, lanes: LaneData, healthy: LaneData, pi_b: Behaviour
) -> tuple[TrainState, LaneData]:
    """Collects pi_B's healthy experience, keeps it for replay where asked, and starts actors from pi_B.

    Args:
        engine: the compiled program.
        state: at step 0; its world and replay are used up for the collection and made anew.
        lanes: the rows, on the damaged robot.
        healthy: the rows, on the healthy robot.
        pi_b: the first teacher.

    Returns:
        The state at step 0 and `lanes` with the healthy replay.
    """
    program = engine.program
    started = [algo for algo, agent in program.agents.items() if agent.adopt]
    if not started and not lanes.prior:
        return state, lanes
    steps = program.settings.prior_steps
    state = state._replace(world=engine.new_world(healthy))
    state, _ = engine.chunk(
        state, tallies.empty(program), healthy, COLLECT(noise=CLONE_NOISE), steps // program.environments
    )
    experience = {algo: first_steps(program, algo, state, steps) for algo in {*started, *lanes.prior}}
    agents = dict(state.agents)
    for algo in started:
        agents[algo] = start_actor(program, algo, agents[algo], experience[algo].observation, healthy, pi_b)
    prior = {algo: on_rows(program, experience[algo]) for algo in lanes.prior}
    clock = on_all(program, jnp.zeros((), jnp.int32))
    return state._replace(clock=clock, agents=agents, world=engine.new_world(lanes)), lanes._replace(prior=prior)


def first_steps(program: Program, algo: str, state: TrainState, count: int) -> Transition:
    """The first `count` transitions that an algorithm's lanes have stored, leaves [n, count, ...]."""
    now, places = state.clock // program.environments, jnp.arange(count)
    return jax.jit(jax.vmap(lambda memory: replays.take(memory, places, now, program.sizes)))(state.replay[algo])


def start_actor(program: Program, algo: str, agents: Any, seen: jax.Array, lanes: LaneData, pi_b: Behaviour) -> Any:
    """Agents that have taken pi_B's actor as their own where it fits their network, its clone otherwise."""
    agent, index = program.agents[algo], program.layout.rows_of[algo]
    adopt, network = agent.adopt, agent.network
    assert adopt is not None and network is not None
    teachers = jax.tree.map(lambda x: x[index], lanes.teachers)
    if pi_b.architecture == network.architecture:
        return adopt(agents, on_rows(program, jax.tree.map(jnp.copy, teachers[0])))

    def lane(args):
        params, observations, key = args
        teacher = bind_teachers(program, algo, params)[0]
        updates = program.settings.clone_updates
        size = program.action_size
        return behaviour.clone(teacher, observations, key, config=network, updates=updates, action_size=size)[0]

    keys = lane_keys(program.layout.of(algo), "clone")
    block = 0 if program.wide else program.settings.update_block
    imitate = jax.jit(lambda args: blocked_map(jax.vmap(lane), args, block))
    actor = imitate((teachers, seen, keys))
    return adopt(agents, on_rows(program, actor))
