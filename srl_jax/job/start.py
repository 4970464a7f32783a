"""Step 0 of a run: random agents, pi_B's healthy experience, and students that start from pi_B."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour, registry
from srl_jax.blocks import blocked_map
from srl_jax.env import hexapod
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.job import plan
from srl_jax.program import lanes as lane_table
from srl_jax.program import replay as replays
from srl_jax.program.engine import Engine, on_all, on_rows, replaying
from srl_jax.program.state import COLLECT, LaneData, Program, TrainState, bind_teachers, sharding

CLONE_NOISE = 0.25  # on pi_B's actions while its healthy experience is collected, so that a clone sees its own errors


def init_agents(program: Program, lanes: LaneData) -> dict[str, Any]:
    """Every row's agent before it has learned anything."""
    size = hexapod.observation_size(program.config.task, program.config.env)
    agents = {}
    for algo, _ in program.layout.counts:
        config = program.agent_config(algo)
        keys = jnp.stack([lane_table.key(lane, "agent") for lane in program.layout.of(algo)])

        def init(key: jax.Array, params: tuple, config=config, algo=algo):
            teachers = bind_teachers(program, algo, params)
            return registry.module(config).init(key, size, ACTION_SIZE, config=config, teachers=teachers)

        index = rows_of(program, algo)
        teachers = jax.tree.map(lambda x, index=index: x[index], lanes.teachers)
        agents[algo] = jax.jit(jax.vmap(init), out_shardings=sharding(program))(on_rows(program, keys), teachers)
    return agents


def init_state(engine: Engine, lanes: LaneData) -> TrainState:
    """Everything at step 0: random agents, empty replay, robots at the start of an episode."""
    program = engine.program
    rows, capacity = len(program.layout.rows), plan.capacity(program.config)
    size = replays.width(hexapod.observation_size(program.config.task, program.config.env), ACTION_SIZE)
    place = sharding(program)
    empty = jax.jit(lambda: replays.Replay(jnp.zeros((rows, capacity, size))), out_shardings=place)
    return TrainState(
        clock=on_all(program, jnp.zeros((), jnp.int32)),
        agents=init_agents(program, lanes),
        replay=empty(),
        world=engine.new_world(lanes),
        alive=on_rows(program, jnp.ones(rows, bool)),
    )


def from_behaviour(
    engine: Engine, state: TrainState, lanes: LaneData, healthy: LaneData, network: bool
) -> tuple[TrainState, LaneData]:
    """Collects pi_B's healthy experience, keeps it for replay where asked, and starts actors from pi_B.

    Args:
        engine: the compiled program.
        state: at step 0; its world and replay are used up for the collection and made anew.
        lanes: the rows, on the damaged robot.
        healthy: the rows, on the healthy robot.
        network: whether pi_B's parameters fit the actors.

    Returns:
        The state at step 0 and `lanes` with the healthy replay.
    """
    program = engine.program
    config = program.config.train
    cloned = [a for a, _ in program.layout.counts if getattr(program.agent_config(a), "init", "") == "behaviour"]
    replayed = replaying(program)
    if not cloned and not replayed:
        return state, lanes
    count = config.prior_steps // config.environments
    state = state._replace(world=engine.new_world(healthy))
    state, _ = engine.chunk(state, healthy, COLLECT(noise=CLONE_NOISE), count)
    experience = jax.jit(lambda rows: rows[:, : config.prior_steps])(state.replay.rows)
    index = {a: rows_of(program, a) for a in {*cloned, *replayed}}
    agents = dict(state.agents)
    for algo in cloned:
        agents[algo] = start_actor(program, algo, agents[algo], experience[index[algo]], healthy, index[algo], network)
    prior = {algo: on_rows(program, experience[index[algo]]) for algo in replayed}
    clock = on_all(program, jnp.zeros((), jnp.int32))
    state = state._replace(clock=clock, agents=agents, world=engine.new_world(lanes))
    return state, lanes._replace(prior=prior)


def rows_of(program: Program, algo: str) -> np.ndarray:
    """Indices of one algorithm's rows among all rows: i[n]."""
    return np.array([i for i, lane in enumerate(program.layout.rows) if lane.algo == algo])


def start_actor(
    program: Program,
    algo: str,
    agents: Any,
    experience: jax.Array,
    lanes: LaneData,
    index: np.ndarray,
    network: bool,
) -> Any:
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
            teacher = bind_teachers(program, algo, params)[0]
            updates = program.config.train.clone_updates
            return behaviour.clone(teacher, seen, key, config=config, updates=updates, action_size=ACTION_SIZE)[0]

        block = 0 if program.wide else program.config.train.update_block
        actor = jax.jit(lambda args: blocked_map(jax.vmap(lane), args, block))((teachers, observations, keys))
    actor = on_rows(program, actor)
    started = agents._replace(actor=actor)
    if "target_actor" in agents._fields:
        started = started._replace(target_actor=jax.tree.map(jnp.copy, actor))  # donated buffers must not alias
    return started
