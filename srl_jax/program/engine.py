"""The program on its devices: compiled once, with its rows' constants laid beside it."""

import itertools
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from srl_jax import machine
from srl_jax.agents import hyper as hypers
from srl_jax.agents.sweep import AgentSettings
from srl_jax.env import damage as damages
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState
from srl_jax.program import mix, strides
from srl_jax.program.act import init_world
from srl_jax.program.lanes import MIX, Lane, Layout
from srl_jax.program.randomness import lane_keys, per_robot
from srl_jax.program.state import AXIS, LaneData, Mode, Program, TrainState, World, on_all, on_rows, rows_sharding
from srl_jax.program.step import make_chunk
from srl_jax.program.tally import Measured, Tally, by_metric
from srl_jax.types import Params, Transition

EVERY = np.iinfo(np.int32).max  # no limit to the episodes that count


def lane_mesh(layout: Layout) -> Mesh:
    """A mesh of the first `layout.devices` devices."""
    devices = jax.devices()[: layout.devices]
    mesh = jax.make_mesh((layout.devices,), (AXIS,), (jax.sharding.AxisType.Auto,), devices=devices)
    assert isinstance(mesh, Mesh)
    return mesh


class Engine:
    """A program compiled once: `chunk` advances every lane, `new_world` starts their episodes."""

    def __init__(self, program: Program):
        self.program = program
        self.compile_seconds = 0.0
        self._chunk = make_chunk(program)
        self._compiled: Callable | None = None
        self._new_world = jax.jit(partial(_new_world, program), out_shardings=rows_sharding(program))
        gauges = {algo: agent.gauge for algo, agent in program.agents.items() if agent.gauge}
        self._gauges = jax.jit(lambda agents: {a: jax.vmap(gauge)(agents[a]) for a, gauge in gauges.items()})

    def chunk(
        self, state: TrainState, tally: Tally, lanes: LaneData, mode: Mode, steps: int
    ) -> tuple[TrainState, Tally]:
        """Advances every lane by `steps` vector steps; compiles at the first call. `state` and `tally` are donated."""
        args = (state, tally, lanes, *on_all(self.program, (mode, jnp.int32(steps))))
        compiled = self._compiled
        if compiled is None:
            start = time.perf_counter()
            compiled = self._compiled = self._chunk.lower(*args).compile()
            self.compile_seconds = time.perf_counter() - start
            refuse_deadlock(compiled, self.program.layout.devices)
        return compiled(*args)

    def new_world(self, lanes: LaneData, first: int = 0, limit: int = EVERY) -> World:
        """Robots at the start of an episode, by the rows' keys and damage.

        Args:
            lanes: the rows.
            first: number of the first robot's episode; the i-th episode's start depends on i, not on E.
            limit: episodes from this number on are not counted by a tally of first episodes.
        """
        return self._new_world(lanes.key, lanes.damage, lanes.starts, jnp.int32(first), jnp.int32(limit))

    def gauges(self, agents: dict[str, Any]) -> dict[str, Measured]:
        """The running totals of the agents that have some, by metric."""
        return by_metric(self.program, jax.device_get(self._gauges(agents)))


def refuse_deadlock(compiled: Any, devices: int) -> None:
    """Refuses a program that would hang: LAPACK waits for another thread of XLA's pool, and all of them are devices.

    Raises:
        ValueError: it calls LAPACK on several devices of a CPU, and the pool is no larger.
    """
    short = jax.default_backend() == "cpu" and 1 < devices >= machine.xla_threads(devices)
    if short and "lapack" in compiled.as_text():
        raise ValueError(
            f"NPROC is {os.environ.get('NPROC', 'not set')}: this program solves linear systems on {devices} devices "
            f"at once, for which XLA needs more threads than devices; set NPROC={2 * devices} before it starts."
        )


def _new_world(
    program: Program, keys: jax.Array, damage: Damage, starts: EnvState | None, first: jax.Array, limit: jax.Array
) -> World:
    world = init_world(program, per_robot(keys, first, program.environments), damage, starts)
    beyond = (first + jnp.arange(program.environments) >= limit).astype(jnp.float32)
    finished = jnp.broadcast_to(beyond[None], keys.shape + beyond.shape)
    return world._replace(episode=world.episode._replace(finished=finished))


def lane_data(
    program: Program,
    settings: dict[str, AgentSettings],
    teachers: Sequence[Callable[[Sequence[Lane]], Params]],
    stream: str,
    damage_names: Sequence[str],
) -> LaneData:
    """The rows' keys for a stream of randomness, their damage, hyper-parameters and teachers; no healthy replay yet.

    Args:
        program: static parts.
        settings: of every algorithm.
        teachers: for each of the program's teachers, the parameters of n lanes, leaves [n, ...].
        stream: name of the stream.
        damage_names: one per row; `MIX` is the program's.
    """
    layout = program.layout
    chosen = {algo: [dict(lane.variant) for lane in layout.of(algo)] for algo in layout.algos}
    damage = damage_rows(damage_names, program.mix, program.robot.anatomy)
    data = LaneData(
        key=lane_keys(layout.rows, stream),
        damage=damage,
        hyper={algo: hypers.stack(settings[algo], rows) for algo, rows in chosen.items()},
        teachers=tuple(params(layout.rows) for params in teachers),
        prior=empty_prior(program),
        starts=in_mid_stride(program, damage),
    )
    return on_rows(program, data)


def damage_rows(names: Sequence[str], mixed: Sequence[str] = (), anatomy: Anatomy = PHANTOMX) -> Damage:
    """The damage of rows, leaves [R, ...]; each name is built once.

    Args:
        names: one per row.
        mixed: M damages, where robots of a row may carry different ones: leaves [R, M, ...]. A row called `MIX` has all
            of them, and a row of any other name has that one M times.
        anatomy: of the robot.
    """
    each = [mixed if name == MIX else [name] * max(len(mixed), 1) for name in names]
    unique = list(dict.fromkeys(itertools.chain(*each)))
    place = {name: index for index, name in enumerate(unique)}
    index = np.array([[place[name] for name in own] for own in each])
    index = index if mixed else index[:, 0]
    return jax.tree.map(lambda x: x[index], damages.stack(unique, anatomy))


def with_damage(program: Program, lanes: LaneData, names: Sequence[str]) -> LaneData:
    """The same rows under other damage, one name per row."""
    damage = damage_rows(names, program.mix, program.robot.anatomy)
    return lanes._replace(**on_rows(program, {"damage": damage, "starts": in_mid_stride(program, damage)}))


def in_mid_stride(program: Program, damage: Damage) -> EnvState | None:
    """Robots of every row that walked when their damage struck, where some episodes start from such."""
    if program.robot.config.stride_starts == 0.0:
        return None
    keys = lane_keys(program.layout.rows, "strides")
    if not program.mix:
        return strides.make(program.robot, damage, keys)
    # Row by row: every damage of a mix has as many starts, and those of all rows would be too many robots at once.
    each = per_robot(keys, 0, len(program.mix))
    rows = [strides.make(program.robot, mix.taken(damage, row), each[row]) for row in range(len(each))]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *rows)


def with_stream(program: Program, lanes: LaneData, stream: str) -> LaneData:
    """The same rows with the keys of another stream of randomness."""
    return lanes._replace(key=on_rows(program, lane_keys(program.layout.rows, stream)))


def reopened(program: Program, agents: dict[str, Any], clock: int) -> dict[str, Any]:
    """The agents after they were told that the damage has changed; most learn on and ask for nothing."""
    now = jnp.int32(clock // program.environments)
    told = {algo: agent.reopen for algo, agent in program.agents.items() if agent.reopen}
    new = {algo: jax.jit(jax.vmap(told[algo], (0, None)))(agents[algo], now) for algo in told}
    return agents | {algo: on_rows(program, state) for algo, state in new.items()}


def empty_prior(program: Program) -> dict[str, Transition]:
    """Room for the healthy transitions of the algorithms that replay them."""
    steps, size = program.settings.prior_steps, program.observation_size
    healthy = [algo for algo, agent in program.agents.items() if agent.replays_healthy]

    def room(rows: int) -> Transition:
        zeros = partial(jnp.zeros, (rows, steps))
        wide = lambda width: jnp.zeros((rows, steps, width))  # noqa: E731
        return Transition(wide(size), wide(program.action_size), zeros(), zeros(), wide(size), zeros(), zeros())

    return {algo: room(len(program.layout.rows_of[algo])) for algo in healthy}
