"""What surrounds the chunk: rows of damage, and agents that are told of another damage."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.config import preset
from srl_jax.env import damage
from srl_jax.env.settings import EnvConfig
from srl_jax.job import plan, start
from srl_jax.job.teachers import scripted_gait
from srl_jax.program import engine as engines
from srl_jax.program.lanes import lay_out
from srl_jax.program.state import on_rows


def test_damage_rows_are_those_of_their_names():
    rows = engines.damage_rows(["leg_rm", "healthy", "leg_rm"])
    for place, name in enumerate(("leg_rm", "healthy", "leg_rm")):
        jax.tree.map(lambda x, y, i=place: np.testing.assert_array_equal(x[i], y), rows, damage.build(name))


@pytest.fixture(scope="module")
def searching():
    """A program of trial and error and a frozen gait on two devices, never compiled, and its agents."""
    config = dataclasses.replace(preset("smoke"), algos="ite,tripod", task="x", env=EnvConfig(), seeds="3")
    teachers = (scripted_gait(),)
    program = start.make_program(config, lay_out(plan.make(config).lanes, 2), teachers)
    names = ["leg_rm"] * len(program.layout.rows)
    return program, start.init_agents(program, start.make_lanes(program, config, teachers, "train", names))


def test_a_search_that_is_over_is_opened_again_when_the_damage_changes(searching):
    program, agents = searching
    over = jnp.ones_like(agents["ite"].over)
    done = agents | {"ite": on_rows(program, agents["ite"]._replace(over=over, seconds=over * 35.0))}
    told = engines.reopened(program, done, clock=4_000)
    assert not np.asarray(told["ite"].over).any()
    assert np.all(np.asarray(told["ite"].since) == 400), "in control steps: earlier episodes are no trials"
    assert np.all(np.asarray(told["ite"].seconds) == 35.0), "robot time goes on counting"
    assert told["tripod"] is done["tripod"]


def test_gauges_are_running_totals_as_they_stand(searching):
    program, agents = searching
    engine = engines.Engine(program)
    spent = jnp.arange(4.0) * 10.0
    found = engine.gauges(agents | {"ite": agents["ite"]._replace(seconds=spent)})
    rows = program.layout.rows_of["ite"]
    assert found["trial_seconds"].rows.tolist() == rows.tolist()
    np.testing.assert_array_equal(found["trial_seconds"].values, spent)


SYSTEM = jnp.eye(3)


@pytest.mark.parametrize(
    ("function", "threads", "devices", "refused"),
    [
        (jnp.linalg.cholesky, "2", 2, True),
        (lambda a: jnp.linalg.solve(a, a), "2", 2, True),
        (jnp.linalg.cholesky, "3", 2, False),  # one to spare
        (jnp.linalg.cholesky, "1", 1, False),  # no other device waits
        (lambda a: jnp.tanh(a @ a), "2", 2, False),  # it calls no LAPACK
    ],
)
def test_what_would_wait_for_ever_is_refused(function, threads, devices, refused, monkeypatch):
    monkeypatch.setenv("NPROC", threads)
    compiled = jax.jit(function).lower(SYSTEM).compile()
    if not refused:
        return engines.refuse_deadlock(compiled, devices)
    with pytest.raises(ValueError, match=r"NPROC is 2: .*set NPROC=4"):
        engines.refuse_deadlock(compiled, devices)
