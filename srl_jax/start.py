"""The beginning of a run: the program, its rows, pi_B's healthy experience, and agents that start from it."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from srl_jax import lanes as lane_table
from srl_jax import replay as replays
from srl_jax.agents import behaviour, ddpg
from srl_jax.agents.hyper import Hyper, from_config
from srl_jax.blocks import blocked_map
from srl_jax.config import Config
from srl_jax.env import damage as damages
from srl_jax.env import gait as gaits
from srl_jax.env import hexapod
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.lanes import Layout
from srl_jax.train import (
    AXIS,
    COLLECT,
    LaneData,
    Program,
    TrainState,
    agent_module,
    bind_teachers,
    init_world,
    sharding,
)
from srl_jax.types import Params

CLONE_NOISE = 0.25  # on pi_B's actions while its healthy experience is collected, so that a clone sees its own errors


@dataclasses.dataclass(frozen=True)
class Behaviour:
    """pi_B: a function of (parameters, observation), and its parameters for every seed."""

    apply: Callable[[Params, jax.Array], jax.Array]
    params: Callable[[int], Params]  # seed -> parameters
    clock_hz: float
    network: bool = False  # whether an actor of the same architecture can start from its parameters


def scripted_gait() -> Behaviour:
    """The tuned tripod gait as pi_B, the same for every seed."""
    gait = gaits.load()
    return Behaviour(gaits.act, lambda seed: gait, float(gait.frequency))


def make_program(config: Config, layout: Layout, teachers: tuple[Behaviour, ...]) -> Program:
    """The static parts of a run's one program, on the first `layout.devices` devices."""
    robot = hexapod.make(config.task, config.env, teachers[0].clock_hz)
    devices = jax.devices()[: layout.devices]
    mesh = jax.make_mesh((layout.devices,), (AXIS,), (jax.sharding.AxisType.Auto,), devices=devices)
    assert isinstance(mesh, Mesh)
    return Program(config, layout, robot, tuple(t.apply for t in teachers), mesh, devices[0].platform != "cpu")


def on_rows(program: Program, rows: Any) -> Any:
    """Puts a pytree of host arrays with a leading row axis onto the program's devices."""
    return jax.device_put(rows, sharding(program))


def stack(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


def lane_data(program: Program, teachers: tuple[Behaviour, ...], stream: str, damage_names: list[str]) -> LaneData:
    """The rows' keys for a stream of randomness, their damage, hyper-parameters and teachers; no healthy replay yet."""
    layout = program.layout
    unique = sorted(set(damage_names))
    stacked = damages.stack(unique)
    index = np.array([unique.index(name) for name in damage_names])
    hyper: dict[str, Hyper] = {
        algo: stack([from_config(program.agent_config(algo), **dict(lane.variant)) for lane in layout.of(algo)])
        for algo, _ in layout.counts
    }
    data = LaneData(
        key=jnp.stack([lane_table.key(lane, stream) for lane in layout.rows]),
        damage=jax.tree.map(lambda x: x[index], stacked),
        hyper=hyper,
        teachers=tuple(stack([t.params(lane.seed) for lane in layout.rows]) for t in teachers),
        prior={},
    )
    return on_rows(program, data)


def init_agents(program: Program) -> dict[str, ddpg.AgentState]:
    """Randomly initialised agents of every row."""
    size = hexapod.observation_size(program.config.task, program.config.env)
    agents = {}
    for algo, _ in program.layout.counts:
        config = program.agent_config(algo)
        keys = jnp.stack([lane_table.key(lane, "agent") for lane in program.layout.of(algo)])
        init = partial(agent_module(config).init, observation_size=size, action_size=ACTION_SIZE, config=config)
        agents[algo] = jax.jit(jax.vmap(init), out_shardings=sharding(program))(on_rows(program, keys))
    return agents


def init_state(program: Program, lanes: LaneData) -> TrainState:
    """Everything at step 0: random agents, empty replay, robots at the start of an episode."""
    train, rows = program.config.train, len(program.layout.rows)
    size = replays.width(hexapod.observation_size(program.config.task, program.config.env), ACTION_SIZE)
    place = sharding(program)
    empty = jax.jit(lambda: replays.Replay(jnp.zeros((rows, train.capacity, size))), out_shardings=place)
    return TrainState(
        clock=jnp.zeros((), jnp.int32),
        agents=init_agents(program),
        replay=empty(),
        world=new_world(program, lanes),
        alive=on_rows(program, jnp.ones(rows, bool)),
    )


def new_world(program: Program, lanes: LaneData):
    """Robots at the start of an episode, by the rows' keys."""
    return jax.jit(partial(init_world, program), out_shardings=sharding(program))(lanes.key, lanes.damage)


def needs_prior(program: Program) -> dict[str, bool]:
    """Which algorithms replay healthy transitions."""
    fractions = {a: getattr(program.agent_config(a), "prior_fraction", (0.0,)) for a, _ in program.layout.counts}
    return {algo: max(values) > 0.0 for algo, values in fractions.items()}


def from_behaviour(
    program: Program, chunk: Callable, state: TrainState, lanes: LaneData, healthy: LaneData, network: bool
) -> tuple[TrainState, LaneData]:
    """Collects pi_B's healthy experience, keeps it for replay where asked, and starts actors from pi_B.

    Args:
        program: static parts.
        chunk: the compiled program.
        state: at step 0; its world and replay are used up for the collection and made anew.
        lanes: the rows, on the damaged robot.
        healthy: the rows, on the healthy robot.
        network: whether pi_B's parameters fit the actors.

    Returns:
        The state at step 0 and `lanes` with the healthy replay.
    """
    config = program.config.train
    cloned = [a for a, _ in program.layout.counts if program.agent_config(a).init == "behaviour"]
    replayed = [a for a, wanted in needs_prior(program).items() if wanted]
    if not cloned and not replayed:
        return state, lanes
    count = config.prior_steps // config.environments
    state = state._replace(world=new_world(program, healthy))
    state, _ = chunk(state, healthy, COLLECT(noise=CLONE_NOISE), jnp.int32(count))
    experience = jax.jit(lambda rows: rows[:, : config.prior_steps])(state.replay.rows)
    index = {a: rows_of(program, a) for a in {*cloned, *replayed}}
    agents = dict(state.agents)
    for algo in cloned:
        agents[algo] = start_actor(program, algo, agents[algo], experience[index[algo]], healthy, index[algo], network)
    prior = {algo: on_rows(program, experience[index[algo]]) for algo in replayed}
    state = state._replace(clock=jnp.zeros((), jnp.int32), agents=agents, world=new_world(program, lanes))
    return state, lanes._replace(prior=prior)


def rows_of(program: Program, algo: str) -> np.ndarray:
    """Indices of one algorithm's rows among all rows: i[n]."""
    return np.array([i for i, lane in enumerate(program.layout.rows) if lane.algo == algo])


def start_actor(
    program: Program,
    algo: str,
    agents: ddpg.AgentState,
    experience: jax.Array,
    lanes: LaneData,
    index: np.ndarray,
    network: bool,
) -> ddpg.AgentState:
    """Agents whose actors, online and target, are pi_B or its clone."""
    config = program.agent_config(algo)
    teachers = jax.tree.map(lambda x: x[index], lanes.teachers)
    if network:
        actor = teachers[0]
    else:
        observations = experience[..., : hexapod.observation_size(program.config.task, program.config.env)]
        keys = jnp.stack([lane_table.key(lane, "clone") for lane in program.layout.of(algo)])

        def lane(args):
            params, seen, key = args
            teacher = bind_teachers(program, params)[0]
            updates = program.config.train.clone_updates
            return behaviour.clone(teacher, seen, key, config=config, updates=updates, action_size=ACTION_SIZE)[0]

        block = 0 if program.wide else program.config.train.update_block
        actor = jax.jit(lambda args: blocked_map(jax.vmap(lane), args, block))((teachers, observations, keys))
    actor = on_rows(program, actor)
    target = jax.tree.map(jnp.copy, actor)  # donated buffers must not alias
    return agents._replace(actor=actor, target_actor=target)
