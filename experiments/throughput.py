"""Where the time goes: steps and updates per second for several lane counts, beside what the machine itself can do.

    python -m experiments.throughput --lanes 12 60 120

The limits are C MuJoCo stepping the same robot on the same cores (`mujoco.rollout`, one thread a core) and a square
sgemm. A lane count is split evenly between DDPG and SRL. Acting and physics are timed by a chunk that does not learn;
learning is what a training chunk takes beyond that. Every figure is the best of `repeats`: noise only ever slows down.
"""

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import tyro
from mujoco import rollout
from rich.console import Console
from rich.table import Table

from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave


@dataclasses.dataclass(frozen=True)
class Arguments:
    """What to time."""

    lanes: tuple[int, ...] = (12, 60, 120)
    """Lanes in all, half of them DDPG and half SRL."""
    devices: str = "auto"
    vector_steps: int = 50
    """Vector steps in a timed chunk."""
    repeats: int = 3


def best(action: Callable[[], Any], repeats: int) -> float:
    """Seconds of the fastest of several calls, after one to warm up."""
    action()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


def c_mujoco_rate(threads: int, repeats: int) -> float:
    """Physics steps per second of C MuJoCo, all cores, random position targets about the stance."""
    from srl_jax.env.model import load_model, stance

    model, robots, steps = load_model(), 8 * threads, 500
    data = [mujoco.MjData(model) for _ in range(threads)]
    mujoco.mj_resetDataKeyframe(model, data[0], 0)
    first = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data[0], first, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    wobble = 0.2 * np.sin(np.arange(steps) / 5.0)[None, :, None]
    control = stance(model)[7:] + wobble * np.ones((robots, 1, model.nu))
    seconds = best(lambda: rollout.rollout(model, data, np.tile(first, (robots, 1)), control), repeats)
    return robots * steps / seconds


def sgemm_rate(repeats: int) -> float:
    """Floating-point operations per second of a float32 matrix product on all cores, by XLA as everything else."""
    import jax
    import jax.numpy as jnp

    size = 2048
    matrix = jax.random.normal(jax.random.key(0), (size, size))
    product = jax.jit(jnp.matmul)
    return 2.0 * size**3 / best(lambda: product(matrix, matrix).block_until_ready(), repeats)


def time_lanes(count: int, devices: int, arguments: Arguments) -> dict[str, float]:
    """Seconds a vector step takes with and without learning, and the seconds of compiling, for a number of lanes."""
    import jax

    from srl_jax.config import preset
    from srl_jax.job import plan, start
    from srl_jax.job import teachers as sources
    from srl_jax.program import engine as engines
    from srl_jax.program import lanes
    from srl_jax.program.state import STUDENT, TRAIN

    base = preset("default")
    train = dataclasses.replace(base.train, capacity=4_000, warmup=8, prior_steps=800)
    config = dataclasses.replace(base, seeds=str(count // 2), damage="leg_rm", train=train)
    layout = lanes.lay_out(plan.make(config).lanes, devices)
    teachers = (sources.scripted_gait(),)
    engine = engines.Engine(engines.make_program(config, layout, teachers))
    data = engines.lane_data(engine.program, teachers, "train", [lane.damage for lane in layout.rows])
    state = start.init_state(engine, data)

    def go(mode) -> None:
        nonlocal state
        state, _ = engine.chunk(state, data, mode, arguments.vector_steps)
        jax.block_until_ready(state)

    acting = best(lambda: go(STUDENT()), arguments.repeats) / arguments.vector_steps
    training = best(lambda: go(TRAIN()), arguments.repeats) / arguments.vector_steps
    return {"acting": acting, "training": training, "compile": engine.compile_seconds, "lanes": 2 * (count // 2)}


def update_flops() -> float:
    """Operations of one update, mean of DDPG and SRL, as the compiler counts them.

    It counts a loop's body once, so the critic's mini-batches after the first are missing: a lower bound.
    """
    import jax
    import jax.numpy as jnp
    from jax.tree_util import Partial

    from srl_jax.agents import registry
    from srl_jax.agents.hyper import from_config
    from srl_jax.config import preset
    from srl_jax.env.hexapod import ACTION_SIZE, observation_size
    from srl_jax.job import plan
    from srl_jax.job.teachers import scripted_gait
    from srl_jax.program.replay import unpack, width

    config, counts = preset("default"), []
    size = observation_size(config.task, config.env)
    gait = scripted_gait()
    for agent in (config.ddpg, config.srl):
        module, hyper = registry.module(agent), from_config(agent)
        state = module.init(jax.random.key(0), size, ACTION_SIZE, config=agent)
        batch = unpack(jnp.zeros((agent.batch, width(size, ACTION_SIZE))), size)
        teachers = (Partial(gait.apply, gait.params(plan.make(config).lanes[0])),)
        settings = {"config": agent, "hyper": hyper, "step": jnp.float32(1e6), "teachers": teachers}
        update = jax.jit(lambda s, b, k, module=module, settings=settings: module.update(s, b, k, **settings))
        cost: Any = update.lower(state, batch, jax.random.key(0)).compile().cost_analysis()
        counts.append(float(cost["flops"]))
    return float(np.mean(counts))


def main() -> None:
    """Times and prints the table."""
    arguments = tyro.cli(Arguments)
    devices = use_devices(arguments.devices)

    from srl_jax.config import preset
    from srl_jax.env.hexapod import SUBSTEPS

    c_rate, peak, flops = c_mujoco_rate(devices, arguments.repeats), sgemm_rate(arguments.repeats), update_flops()
    console, environments = Console(), preset("default").train.environments
    console.print(f"{devices} devices; C MuJoCo {c_rate:,.0f} physics steps/s; sgemm {peak / 1e9:,.0f} GFLOP/s; ")
    console.print(f"one update is at least {flops / 1e6:.1f} MFLOP (mean of DDPG and SRL)")
    table = Table(
        "lanes", "compile s", "env steps/s", "physics/s acting", "of C", "updates/s learning", "of sgemm", box=None
    )
    for count in arguments.lanes:
        found = time_lanes(count, devices, arguments)
        physics = found["lanes"] * environments * SUBSTEPS / found["acting"]
        learning = found["lanes"] / max(found["training"] - found["acting"], 1e-9)
        table.add_row(
            f"{found['lanes']:.0f}",
            f"{found['compile']:.0f}",
            f"{found['lanes'] * environments / found['training']:,.0f}",
            f"{physics:,.0f}",
            f"{physics / c_rate:.0%}",
            f"{learning:,.0f}",
            f"{learning * flops / peak:.0%}",
        )
    console.print(table)


if __name__ == "__main__":
    leave(main)
