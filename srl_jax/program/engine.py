"""The program on its devices: compiled once, with its rows' constants laid beside it."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from srl_jax.agents.hyper import Hyper, from_config
from srl_jax.config import Config
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.job.teachers import Behaviour
from srl_jax.program import lanes as lane_table
from srl_jax.program import replay as replays
from srl_jax.program.lanes import Layout
from srl_jax.program.state import AXIS, LaneData, Mode, Program, Tally, TrainState, World, sharding, zero_tally
from srl_jax.program.step import init_world, make_chunk


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
        compiled = self._compiled
        if compiled is None:
            start = time.perf_counter()
            compiled = self._compiled = self._chunk.lower(*args).compile()
            self.compile_seconds = time.perf_counter() - start
        return compiled(*args)

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
        teachers=tuple(stack([t.params(lane) for lane in layout.rows]) for t in teachers),
        prior=empty_prior(program),
    )
    return on_rows(program, data)


def damage_rows(names: list[str]) -> damages.Damage:
    """One damage per row; each name is built once."""
    unique = sorted(set(names))
    index = np.array([unique.index(name) for name in names])
    return jax.tree.map(lambda x: x[index], damages.stack(unique))


def with_damage(program: Program, lanes: LaneData, names: list[str]) -> LaneData:
    """The same rows under other damage, one name per row."""
    return lanes._replace(damage=on_rows(program, damage_rows(names)))


def stream_keys(program: Program, stream: str) -> jax.Array:
    """The rows' keys for a stream of randomness."""
    return on_rows(program, jnp.stack([lane_table.key(lane, stream) for lane in program.layout.rows]))


def empty_tally(program: Program) -> Tally:
    """A tally of nothing for all rows, on the devices."""
    rows = {algo: len(program.layout.of(algo)) for algo, _ in program.layout.counts}
    tally = zero_tally(program, jnp.zeros(len(program.layout.rows)), rows)
    by_row = {name: on_rows(program, getattr(tally, name)) for name in Tally._fields if name != "updates"}
    return Tally(**by_row, updates=on_all(program, tally.updates))


def means(program: Program, tally: Tally, training: bool) -> list[dict[str, float]]:
    """A tally's means, row by row: per episode, and in training also per step and per update; NaN of nothing."""
    sums = [tally.totals, *([tally.rates] if training else [])]
    counts = [tally.episodes, tally.steps]
    position = {algo: 0 for algo, _ in program.layout.counts}
    result = []
    for row, lane in enumerate(program.layout.rows):
        values = {}
        for found, count in zip(sums, counts, strict=False):
            values |= {name: _mean(total[row], count[row]) for name, total in found.items()}
        if training:
            losses, index = tally.losses[lane.algo], position[lane.algo]
            values |= {name: _mean(loss[index], tally.updates) for name, loss in losses.items()}
        position[lane.algo] += 1
        result.append(values)
    return result


def _mean(total: Any, count: Any) -> float:
    return float(total) / float(count) if count else float("nan")


def replaying(program: Program) -> list[str]:
    """The algorithms that replay healthy transitions."""
    fractions = {a: getattr(program.agent_config(a), "prior_fraction", (0.0,)) for a, _ in program.layout.counts}
    return [algo for algo, values in fractions.items() if max(values) > 0.0]


def empty_prior(program: Program) -> dict[str, jax.Array]:
    """Room for the healthy transitions of the algorithms that replay them."""
    size = replays.width(hexapod.observation_size(program.config.task, program.config.env), ACTION_SIZE)
    steps = program.config.train.prior_steps
    return {algo: jnp.zeros((len(program.layout.of(algo)), steps, size)) for algo in replaying(program)}
