"""Where the time goes: steps and updates per second for several lane counts, beside what the machine itself can do.

    python -m experiments.throughput --lanes 12 60 120

The limits are C MuJoCo stepping the same robot on the same cores (`mujoco.rollout`, one thread a core) and a square
sgemm. A lane count is split evenly between DDPG and SRL. Acting and physics are timed by a chunk that does not learn;
learning is what a training chunk takes beyond that. Every figure is the best of `repeats`: noise only ever slows down.
"""

import dataclasses
from functools import partial
from typing import Any, Literal

import numpy as np
import tyro
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
    preset: Literal["default", "smoke"] = "default"
    """Whose networks and batches; smoke is small, to see that it works."""
    randomise: Literal["none", "mild", "wide"] = "none"
    """As --env.randomise of a run: what each robot's differences cost."""


def time_lanes(count: int, devices: int, arguments: Arguments) -> dict[str, float]:
    """Seconds a vector step takes with and without learning, and the seconds of compiling, for a number of lanes."""
    import jax
    import jax.numpy as jnp

    from srl_jax.config import preset
    from srl_jax.job import plan, start
    from srl_jax.job.speed import best
    from srl_jax.job.teachers import scripted_gait
    from srl_jax.program import tally
    from srl_jax.program.engine import Engine
    from srl_jax.program.lanes import lay_out
    from srl_jax.program.state import STUDENT, TRAIN, on_all

    base = preset(arguments.preset)
    capacity, prior = min(base.train.capacity, 4_000), min(base.train.prior_steps, 800)  # memory is not what is timed
    train = dataclasses.replace(base.train, capacity=capacity, prior_steps=prior)
    config = dataclasses.replace(base, seeds=str(count // 2), damage="leg_rm", train=train)
    config = dataclasses.replace(config, env=dataclasses.replace(base.env, randomise=arguments.randomise))
    layout = lay_out(plan.make(config).lanes, devices)
    teachers = (scripted_gait(),)
    engine = Engine(start.make_program(config, layout, teachers))
    lanes = start.make_lanes(engine.program, config, teachers, "train", [lane.damage for lane in layout.rows])
    learning = on_all(engine.program, jnp.int32(train.warmup))
    state, counted = start.init_state(engine, lanes)._replace(clock=learning), tally.empty(engine.program)

    def go(mode) -> None:
        nonlocal state, counted
        state, counted = engine.chunk(state, counted, lanes, mode, arguments.vector_steps)
        jax.block_until_ready(state)

    acting = best(lambda: go(STUDENT()), arguments.repeats) / arguments.vector_steps
    training = best(lambda: go(TRAIN()), arguments.repeats) / arguments.vector_steps
    return {"acting": acting, "training": training, "compile": engine.compile_seconds, "lanes": 2 * (count // 2)}


def update_flops(arguments: Arguments) -> float:
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
    from srl_jax.types import Transition

    config, counts = preset(arguments.preset), []
    size, gait = observation_size(config.task, config.env), scripted_gait()
    params = jax.tree.map(lambda x: x[0], gait.params(plan.make(config).lanes[:1]))
    for algo in ("ddpg", "srl"):
        agent, hyper = registry.agent(config.agent(algo)), from_config(config.agent(algo))
        assert agent.update is not None
        state = agent.init(jax.random.key(0), size, ACTION_SIZE)
        zeros = lambda *shape: jnp.zeros((agent.batch_size, *shape))  # noqa: B023, E731
        batch = Transition(zeros(size), zeros(ACTION_SIZE), zeros(), zeros(), zeros(size), zeros(), zeros())
        learn = partial(agent.update, hyper=hyper, step=jnp.float32(1e6), teachers=(Partial(gait.apply, params),))
        cost: Any = jax.jit(learn).lower(state, batch, jax.random.key(0)).compile().cost_analysis()
        counts.append(float(cost["flops"]))
    return float(np.mean(counts))


def main(arguments: Arguments) -> None:
    """Times and prints the table.

    Raises:
        ValueError: fewer than two lanes, or nothing to time.
    """
    if min(arguments.lanes, default=0) < 2 or arguments.vector_steps < 1 or arguments.repeats < 1:
        raise ValueError(
            f"lanes is {arguments.lanes}, vector_steps {arguments.vector_steps} and repeats {arguments.repeats}; "
            "at least 2, 1 and 1 are needed."
        )
    devices = use_devices(arguments.devices, solves=False)

    from srl_jax.config import preset
    from srl_jax.env.hexapod import SUBSTEPS
    from srl_jax.job.speed import c_mujoco_rate, sgemm_rate

    c_rate, peak, flops = (
        c_mujoco_rate(devices, arguments.repeats),
        sgemm_rate(arguments.repeats),
        update_flops(arguments),
    )
    train = preset(arguments.preset).train
    console, environments = Console(), train.environments
    console.print(f"{devices} devices; C MuJoCo {c_rate:,.0f} physics steps/s; sgemm {peak / 1e9:,.0f} GFLOP/s; ")
    console.print(f"one update is at least {flops / 1e6:.1f} MFLOP (mean of DDPG and SRL)")
    table = Table(
        "lanes", "compile s", "env steps/s", "physics/s acting", "of C", "updates/s learning", "of sgemm", box=None
    )
    for count in arguments.lanes:
        found = time_lanes(count, devices, arguments)
        physics = found["lanes"] * environments * SUBSTEPS / found["acting"]
        learning = found["lanes"] / train.update_every / max(found["training"] - found["acting"], 1e-9)
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
    leave(main, tyro.cli(Arguments))
