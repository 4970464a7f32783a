"""The three tasks against plain NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import task as tasks
from srl_jax.env.settings import EnvConfig

PLACES = [(0.0, 0.0), (0.3, -0.4), (-1.2, 0.5), (0.0, 2.0)]
GOAL = np.array([0.6, 0.3], np.float32)


@pytest.mark.parametrize("place", PLACES)
def test_distances(place):
    expected = {"x": place[0], "xy": np.hypot(*place), "p2p": -np.hypot(*(GOAL - place))}
    for task, value in expected.items():
        assert float(tasks.distance(task, jnp.array(place), GOAL)) == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("place", PLACES)
def test_directions(place):
    out, to_goal = np.add(place, (0.1, 0)), GOAL - place
    expected = {"x": [1, 0], "xy": out / np.hypot(*out), "p2p": to_goal / np.hypot(*to_goal)}
    for task, value in expected.items():
        np.testing.assert_allclose(tasks.direction(task, jnp.array(place), GOAL), value, atol=1e-6)


def test_following_the_direction_earns_distance():
    place = jnp.array([0.3, -0.4])
    for task in ("x", "xy", "p2p"):
        step = 0.01 * tasks.direction(task, place, GOAL)
        gain = tasks.distance(task, place + step, GOAL) - tasks.distance(task, place, GOAL)
        assert float(gain) == pytest.approx(0.01, rel=0.02)  # xy bends slightly towards x near the start


def test_standing_on_the_goal_or_the_start_is_defined():
    np.testing.assert_array_equal(tasks.direction("p2p", jnp.array(GOAL), GOAL), [0, 0])
    np.testing.assert_array_equal(tasks.direction("xy", jnp.zeros(2), GOAL), [1, 0])


def test_goals_fill_the_ring():
    config = EnvConfig(goal_ring=(0.5, 0.7))
    goals = jax.vmap(lambda key: tasks.sample_goal("p2p", config, key))(jax.random.split(jax.random.key(0), 2000))
    radius, angle = np.linalg.norm(goals, axis=1), np.arctan2(goals[:, 1], goals[:, 0])
    assert 0.5 <= radius.min() < 0.501
    assert 0.699 < radius.max() <= 0.7
    counts, _ = np.histogram(angle, bins=8, range=(-np.pi, np.pi))
    assert counts.min() > 190
    for task in ("x", "xy"):
        np.testing.assert_array_equal(tasks.sample_goal(task, config, jax.random.key(0)), [0, 0])


def test_success():
    config = EnvConfig(goal_radius=0.15, sparse_distance=1.0)
    cases = {
        "x": [((1.0, 0.0), True), ((0.99, 3.0), False), ((-2.0, 0.0), False)],
        "xy": [((-0.8, 0.61), True), ((0.6, 0.6), False)],
        "p2p": [((0.6, 0.2), True), ((0.6, 0.1), False)],
    }
    for task, places in cases.items():
        for place, expected in places:
            assert bool(tasks.succeeded(task, config, jnp.array(place), GOAL)) is expected


def test_where_success_ends_the_episode():
    ends = {(task, reward): tasks.ends_on_success(task, EnvConfig(reward=reward)) for task in ("x", "xy", "p2p")
            for reward in ("dense", "sparse")}  # fmt: skip
    assert [key for key, value in ends.items() if not value] == [("x", "dense"), ("xy", "dense")]


@pytest.mark.parametrize("progress", [-1.0, -0.01, 0.0, 0.02, 0.5])
@pytest.mark.parametrize(("success", "fell"), [(False, False), (True, False), (False, True)])
def test_dense_terms(progress, success, fell):
    config = EnvConfig(progress_weight=40.0, effort_weight=0.1, goal_bonus=3.0, fall_penalty=2.0)
    action = np.linspace(-1, 1, 18)
    for goal_task in (True, False):
        terms = tasks.reward_terms(
            config, jnp.float32(progress), jnp.float32(action), jnp.array(success), jnp.array(fell), goal_task
        )
        expected = [
            np.clip(40 * progress, -2, 2),
            -0.1 * np.mean(action**2),
            3.0 * (success and goal_task),
            -2.0 * fell,
        ]
        np.testing.assert_allclose(jnp.stack(terms), expected, rtol=1e-5)


@pytest.mark.parametrize("success", [False, True])
def test_sparse_terms(success):
    config = EnvConfig(reward="sparse")
    terms = tasks.reward_terms(
        config, jnp.float32(0.1), jnp.ones(18), jnp.array(success), jnp.array(True), goal_task=True
    )
    assert [float(term) for term in terms] == [0, 0, float(success), 0]
