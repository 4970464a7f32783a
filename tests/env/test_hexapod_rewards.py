"""What a control step earns and how an episode ends, without physics."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage, hexapod
from tests.env.reference import make, state_at


def moved(robot, start, end, action=None, **where) -> tuple[hexapod.EnvState, hexapod.EnvStep]:
    """`advance` from one place to another, without physics."""
    tilt = where.pop("quaternion", (1.0, 0, 0, 0))
    before, after = state_at(robot, *start, **where), state_at(robot, *end, quaternion=tilt, **where)
    action = jnp.zeros(18) if action is None else action
    advance = jax.jit(partial(hexapod.advance, robot._replace(model=None, data=None)))
    return advance(damage.build("healthy"), before, after, action)


def test_dense_reward_is_the_sum_of_its_terms():
    action = jnp.linspace(-1, 1, 18)
    _, out = moved(make("x"), (0.0, 0.0), (0.02, 0.1), action)
    expected = {"progress": 50 * 0.02, "effort": -0.05 * np.mean(np.square(action)), "goal": 0, "fall": 0}
    assert {name: float(value) for name, value in out.terms._asdict().items()} == pytest.approx(expected, rel=1e-5)
    assert float(out.reward) == pytest.approx(sum(expected.values()), rel=1e-5)
    assert float(out.progress) == pytest.approx(0.02)


def test_reaching_the_goal_terminates_with_a_bonus_and_is_no_time_out():
    robot = make("p2p", episode_steps=100)
    _, out = moved(robot, (0.0, 0.0), (0.02, 0.0), goal=(0.16, 0.0), steps=99)
    assert (bool(out.success), bool(out.terminated), bool(out.truncated)) == (True, True, False)
    assert float(out.terms.goal) == 5.0
    _, out = moved(robot, (0.0, 0.0), (0.0, 0.0), goal=(0.16, 0.0), steps=98)
    assert (bool(out.success), bool(out.terminated), bool(out.truncated)) == (False, False, False)


@pytest.mark.parametrize("task", ["x", "xy", "p2p"])
def test_time_out_truncates(task):
    robot = make(task, episode_steps=7)
    after, out = moved(robot, (0.0, 0.0), (0.01, 0.0), goal=(0.9, 0.0), steps=6)
    assert (bool(out.terminated), bool(out.truncated), int(after.steps)) == (False, True, 7)


@pytest.mark.parametrize(("reward", "penalty"), [("dense", -1.0), ("sparse", 0.0)])
def test_tipping_over_terminates(reward, penalty):
    _, out = moved(make("x", reward=reward), (0.0, 0.0), (0.0, 0.0), quaternion=(0.6, 0.8, 0, 0), steps=99)
    assert (bool(out.fell), bool(out.terminated), bool(out.truncated)) == (True, True, False)
    assert float(out.reward) == penalty


@pytest.mark.parametrize(("task", "end"), [("x", (1.0, 0.0)), ("xy", (-0.8, 0.61)), ("p2p", (0.5, 0.4))])
def test_sparse_reward_is_one_at_success_and_ends_there(task, end):
    robot = make(task, reward="sparse")
    _, out = moved(robot, (0.0, 0.0), end, jnp.ones(18), goal=(0.5, 0.5))
    assert (float(out.reward), bool(out.success), bool(out.terminated)) == (1.0, True, True)
    _, out = moved(robot, (0.0, 0.0), (0.2, 0.2), jnp.ones(18), goal=(0.5, 0.5))
    assert (float(out.reward), bool(out.success), bool(out.terminated)) == (0.0, False, False)


@pytest.mark.parametrize("task", ["x", "xy"])
def test_under_the_dense_reward_distance_alone_ends_nothing(task):
    _, out = moved(make(task), (0.99, 0.0), (1.01, 0.0))
    assert (bool(out.success), bool(out.terminated), float(out.terms.goal)) == (True, False, 0.0)
