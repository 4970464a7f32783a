"""The beginning of a run: the program, its rows, pi_B's healthy experience, and agents that start from it."""

import dataclasses
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

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
    Mode,
    Program,
    Tally,
    TrainState,
    World,
    agent_module,
    bind_teachers,
    init_world,
    make_chunk,
    sharding,
    zero_tally,
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


class Engine:
    """A program compiled once: `chunk` advances every lane, `new_world` starts their episodes."""

    def __init__(self, program: Program):
        self.program = program
        self.compile_seconds = 0.0
        self._chunk = make_chunk(program)
        self._compiled: Callable | None = None
        self._new_world = jax.jit(partial(init_world, program), out_shardings=sharding(program))

    def chunk(self, state: TrainState, lanes: LaneData, mode: Mode, steps: int) -> tuple[TrainState, Tally]:
        """Advances every lane by `steps` vector steps; compiles at the first call. `state` is donated."""
        args = (state, lanes, *on_all(self.program, (mode, jnp.int32(steps))))
        if self._compiled is None:
            start = time.perf_counter()
            self._compiled = self._chunk.lower(*args).compile()
            self.compile_seconds = time.perf_counter() - start
        return self._compiled(*args)

    def new_world(self, lanes: LaneData) -> World:
        """Robots at the start of an episode, by the rows' keys and damage."""
        return self._new_world(lanes.key, lanes.damage)


def on_rows(program: Program, rows: Any) -> Any:
    """Puts a pytree of host arrays with a leading row axis onto the program's devices."""
    return jax.device_put(rows, sharding(program))


def on_all(program: Program, value: Any) -> Any:
    """Puts what all rows share onto every one of the program's devices."""
    return jax.device_put(value, NamedSharding(program.mesh, PartitionSpec()))


def stack(trees: list[Any]) -> Any:
    return jax.tree.map(lambda *x: jnp.stack(x), *trees)


def lane_data(program: Program, teachers: tuple[Behaviour, ...], stream: str, damage_names: list[str]) -> LaneData:
    """The rows' keys for a stream of randomness, their damage, hyper-parameters and teachers; no healthy replay yet."""
    layout = program.layout
    hyper: dict[str, Hyper] = {
        algo: stack([from_config(program.agent_config(algo), **dict(lane.variant)) for lane in layout.of(algo)])
        for algo, _ in layout.counts
    }
    data = LaneData(
        key=jnp.stack([lane_table.key(lane, stream) for lane in layout.rows]),
        damage=damage_rows(damage_names),
        hyper=hyper,
        teachers=tuple(stack([t.params(lane.seed) for lane in layout.rows]) for t in teachers),
        prior=empty_prior(program),
    )
    return on_rows(program, data)


def damage_rows(names: list[str]) -> damages.Damage:
    """One damage per row; each name is built once."""
    unique = sorted(set(names))
    index = np.array([unique.index(name) for name in names])
    return jax.tree.map(lambda x: x[index], damages.stack(unique))


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


def init_state(engine: Engine, lanes: LaneData) -> TrainState:
    """Everything at step 0: random agents, empty replay, robots at the start of an episode."""
    program = engine.program
    train, rows = program.config.train, len(program.layout.rows)
    size = replays.width(hexapod.observation_size(program.config.task, program.config.env), ACTION_SIZE)
    place = sharding(program)
    empty = jax.jit(lambda: replays.Replay(jnp.zeros((rows, train.capacity, size))), out_shardings=place)
    return TrainState(
        clock=on_all(program, jnp.zeros((), jnp.int32)),
        agents=init_agents(program),
        replay=empty(),
        world=engine.new_world(lanes),
        alive=on_rows(program, jnp.ones(rows, bool)),
    )


def replaying(program: Program) -> list[str]:
    """The algorithms that replay healthy transitions."""
    fractions = {a: getattr(program.agent_config(a), "prior_fraction", (0.0,)) for a, _ in program.layout.counts}
    return [algo for algo, values in fractions.items() if max(values) > 0.0]


def empty_prior(program: Program) -> dict[str, jax.Array]:
    """Room for the healthy transitions of the algorithms that replay them."""
    size = replays.width(hexapod.observation_size(program.config.task, program.config.env), ACTION_SIZE)
    steps = program.config.train.prior_steps
    return {algo: jnp.zeros((len(program.layout.of(algo)), steps, size)) for algo in replaying(program)}


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
    cloned = [a for a, _ in program.layout.counts if program.agent_config(a).init == "behaviour"]
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


def with_damage(program: Program, lanes: LaneData, names: list[str]) -> LaneData:
    """The same rows under other damage, one name per row."""
    return lanes._replace(damage=on_rows(program, damage_rows(names)))


def stream_keys(program: Program, stream: str) -> jax.Array:
    """The rows' keys for a stream of randomness."""
    return on_rows(program, jnp.stack([lane_table.key(lane, stream) for lane in program.layout.rows]))


def empty_tally(program: Program) -> Tally:
    """A tally of nothing for all rows, on the host."""
    rows = {algo: len(program.layout.of(algo)) for algo, _ in program.layout.counts}
    return zero_tally(program, np.zeros(len(program.layout.rows), np.float32), rows)


def means(program: Program, tally: Tally, training: bool) -> list[dict[str, float]]:
    """A tally's means, row by row: per episode, and in training also per step and per update."""
    position = {algo: 0 for algo, _ in program.layout.counts}
    result = []
    for row, lane in enumerate(program.layout.rows):
        index = position[lane.algo]
        position[lane.algo] += 1
        values = {name: total[row] / tally.episodes[row] for name, total in tally.totals.items() if tally.episodes[row]}
        if training:
            values |= {name: rate[row] / tally.steps[row] for name, rate in tally.rates.items() if tally.steps[row]}
            losses = tally.losses[lane.algo]
            values |= {name: loss[index] / tally.updates for name, loss in losses.items() if tally.updates}
        result.append({name: float(value) for name, value in values.items()})
    return result
