"""This package's own program as a contender: every lane of a configuration in one compiled program."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

from experiments.contenders.measuring import Runner, calibrated
from srl_jax.config import Config
from srl_jax.job import plan


def started(config: Config, devices: int) -> tuple[Callable[[int], Any], dict[str, Any]]:
    """The program, compiled, with its replays filled up to the first update.

    Args:
        config: of the run.
        devices: over which its lanes are laid.

    Returns:
        What trains for a number of vector steps, and facts: seconds of compiling, bytes by arithmetic.
    """
    from srl_jax.cli.devices import use_devices

    use_devices(str(devices), solves=config.solves)
    import jax

    from srl_jax.job import memory, start, teachers
    from srl_jax.program import tally
    from srl_jax.program.engine import Engine
    from srl_jax.program.lanes import lay_out
    from srl_jax.program.state import TRAIN

    lanes = plan.make(config).lanes
    layout, taught = lay_out(lanes, devices), (teachers.scripted_gait(),)
    engine = Engine(start.make_program(config, layout, taught))
    data = start.make_lanes(engine.program, config, taught, "train", [lane.damage for lane in layout.rows])
    state, counted = start.init_state(engine, data), tally.empty(engine.program)

    def train(vector_steps: int) -> None:
        nonlocal state, counted
        state, counted = jax.block_until_ready(engine.chunk(state, counted, data, TRAIN(), vector_steps))

    train(0)  # compiles
    begin = time.perf_counter()
    train(config.train.warmup // config.train.environments)
    needed = memory.needed(config, lanes, devices)
    facts = {
        "compile_seconds": engine.compile_seconds,
        "warmup_seconds": time.perf_counter() - begin,
        "lanes": len(lanes),
        "arithmetic_bytes": needed.replay + needed.agents + needed.program,
    }
    return train, facts


def of_time(config: Config, devices: int, least: float) -> Runner:
    """Trains for about so many seconds at least; units are environment steps of all lanes together."""
    train, facts = started(config, devices)
    each = config.train.update_every  # vector steps from update to update
    count = calibrated(lambda count: train(count * each), least)
    return Runner(partial(train, count * each), count * each * config.train.environments * facts["lanes"], facts)


def of_steps(config: Config, devices: int, steps: int) -> Runner:
    """Trains for so many environment steps of each lane; a whole run's, from its first step on."""
    if steps >= config.steps:
        environments = config.train.environments

        def whole() -> None:
            train, _ = started(config, devices)
            train((config.steps - config.train.warmup) // environments)

        return Runner(whole, config.steps * len(plan.make(config).lanes), {"whole": True})
    train, facts = started(config, devices)
    facts |= {"done": config.train.warmup, "again_seconds": 0.0, "again_in_start": False}
    return Runner(partial(train, steps // config.train.environments), steps * facts["lanes"], facts)
