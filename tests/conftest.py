"""What every test needs, set before any test module imports jax.

Some tests run `python -m srl_jax.run` in a subprocess, which inherits the variables but not `jax.config`.
"""

import dataclasses
import fcntl
import json
import os
from pathlib import Path

import pytest

DEVICES = 2  # as on the smallest machine this runs on, so that laying lanes over devices is always tested


def pytest_configure(config: pytest.Config) -> None:
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("NPROC", "4")  # XLA's thread pool must be larger than the number of devices
    # Tests wait for the compiler far longer than for what it has compiled.
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
    # Physics takes 10-30 s to compile, so compiled programs are kept; `--cache-clear` drops them.
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(config.cache.mkdir("jax")))

    import jax

    jax.config.update("jax_num_cpu_devices", DEVICES)
    # An axis added by broadcasting is the usual way for one lane to leak into another.
    jax.config.update("jax_numpy_rank_promotion", "raise")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Folders whose tests make whole runs come first, so that no process is left with one of them at the end."""
    long = {"job", "experiments", "program"}
    items.sort(key=lambda item: item.path.parent.name not in long)


@pytest.fixture(scope="session")
def tiny():
    """As small as it can be with every part switched on: 2 seeds of DDPG, SRL and a search, one lost leg."""
    from srl_jax.config import preset
    from srl_jax.program.settings import EvaluationConfig, TrainConfig

    base = preset("smoke")
    small = {"hidden": (16, 16), "batch": 8, "critics": 2, "freeze": (24.0,)}
    return dataclasses.replace(
        base,
        algos="ddpg,srl,bpg",
        bpg=dataclasses.replace(base.bpg, trajectories=2),
        train=TrainConfig(
            environments=2,
            capacity=64,
            warmup=16,
            evaluate_every=40,
            checkpoint_every=40,
            prior_steps=32,
            clone_updates=20,
            physics_block=1,  # several blocks in the program, as in a run of many lanes
            update_block=1,
        ),
        evaluation=EvaluationConfig(episodes=3),
        env=dataclasses.replace(base.env, episode_steps=10),
        ddpg=dataclasses.replace(base.ddpg, **small),
        srl=dataclasses.replace(base.srl, **small, draws=4, prior_fraction=(0.25,), behaviour_target=True),
    )


@pytest.fixture(scope="session")
def teachers():
    """One teacher more than the paper has."""
    from srl_jax.job.teachers import scripted_gait

    return (scripted_gait(),) * 2


@pytest.fixture(scope="session")
def engine(tiny, teachers):
    """The tiny configuration's program, compiled once for all tests that use it."""
    from srl_jax.job import plan, start
    from srl_jax.program.engine import Engine
    from srl_jax.program.lanes import lay_out

    # Four seeds: two rows of each algorithm on a device, so that blocks of one are several.
    lanes = plan.make(dataclasses.replace(tiny, seeds="4")).lanes
    return Engine(start.make_program(tiny, lay_out(lanes, DEVICES), teachers))


@pytest.fixture(scope="session")
def data(engine, tiny, teachers):
    """The rows' constants."""
    from srl_jax.job import start

    names = [lane.damage for lane in engine.program.layout.rows]
    return start.make_lanes(engine.program, tiny, teachers, "train", names)


@pytest.fixture(scope="session")
def fresh(engine, data):
    """() -> a state at step 0, which is made once and copied, since a chunk takes what it is given."""
    import jax
    import jax.numpy as jnp

    from srl_jax.job import start

    state = start.init_state(engine, data)
    return lambda: jax.tree.map(jnp.copy, state)


@pytest.fixture(scope="session")
def trained(engine, fresh):
    """(data, steps, edit, mode) -> a fresh state, edited, after some vector steps, and its tally."""
    from srl_jax.program import tally as tallies
    from srl_jax.program.state import TRAIN

    def advance(data, steps, edit=lambda state: state, mode=None):
        return engine.chunk(edit(fresh()), tallies.empty(engine.program), data, mode or TRAIN(), steps)

    return advance


@pytest.fixture(scope="session")
def smoke_run(tmp_path_factory):
    """An uninterrupted smoke run: its directory, its summary, and how often its physics was traced.

    It is made once for all processes of the tests; who comes second waits. Copy it before changing anything in it.
    """
    from srl_jax.config import preset
    from srl_jax.env import hexapod
    from srl_jax.job.run import run

    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    with (base / "smoke.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = base / "smoke.json"
        if not made.exists():
            directory, traces, step = tmp_path_factory.mktemp("run") / "whole", [], hexapod.step
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(hexapod, "step", lambda *args: (traces.append(1), step(*args))[1])
                summary = run(preset("smoke"), directory, DEVICES)
            made.write_text(json.dumps([str(directory), summary, len(traces)]))
    directory, summary, traces = json.loads(made.read_text())
    return Path(directory), summary, traces


@pytest.fixture(scope="session")
def atlas():
    """See `tests.atlas.untrained`."""
    from tests.atlas import untrained

    return untrained.make()
