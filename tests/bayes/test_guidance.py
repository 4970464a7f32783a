"""The guided set on a grid against breadth-first search, and the area under the curve against counting."""

from collections import deque
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.bayes.guidance import Tabular, auc, guided_set, tabular, value_iteration

SIDE, GAMMA = 7, 0.97
MOVES = ((-1, 0), (0, 1), (1, 0), (0, -1))  # north, east, south, west
GOAL = np.arange(SIDE**2) == (SIDE**2) // 2
solve = jax.jit(partial(value_iteration, gamma=GAMMA))


def target(state: int, action: int, lost: tuple[int, ...] = ()) -> int:
    """Where a move leads: walls and lost actions leave the robot where it is."""
    row, column = divmod(state, SIDE)
    row, column = row + MOVES[action][0], column + MOVES[action][1]
    inside = 0 <= row < SIDE and 0 <= column < SIDE
    return row * SIDE + column if inside and action not in lost else state


def grid(lost: tuple[int, ...] = (), slip: float = 0.0) -> Tabular:
    """The goal in the middle; with probability `slip` the robot moves in a random direction instead."""
    p = np.zeros((4, SIDE**2, SIDE**2))
    for state in range(SIDE**2):
        for action in range(4):
            p[action, state, target(state, action, lost)] += 1.0 - slip
            for other in range(4):
                p[action, state, target(state, other, lost)] += slip / 4
    return tabular(p, GOAL)


def distances(lost: tuple[int, ...]) -> np.ndarray:
    """Steps to the goal by breadth-first search on the reversed moves; inf where there is no way."""
    steps = np.where(GOAL, 0.0, np.inf)
    queue = deque(np.flatnonzero(GOAL))
    while queue:
        here = queue.popleft()
        for state in range(SIDE**2):
            if np.isinf(steps[state]) and here in [target(state, a, lost) for a in range(4)]:
                steps[state] = steps[here] + 1
                queue.append(state)
    return steps


@pytest.mark.parametrize("lost", [(), (1,), (0, 1)])
def test_values_are_those_of_the_shortest_way(lost):
    found = solve(grid(lost))
    steps = distances(lost)
    expected = np.where(GOAL, 1.0, GAMMA ** (steps - 1.0)) / (1.0 - GAMMA)
    assert found.ok
    np.testing.assert_allclose(found.value, expected, rtol=2e-4)


def test_values_with_slip_solve_the_linear_equations():
    problem = grid((1,), slip=0.3)
    found = solve(problem)
    best, states = np.asarray(found.q).argmax(0), np.arange(SIDE**2)
    p, r = np.asarray(problem.transition, float)[best, states], np.asarray(problem.reward, float)[best, states]
    np.testing.assert_allclose(found.value, np.linalg.solve(np.eye(SIDE**2) - GAMMA * p, r), rtol=2e-4, atol=1e-6)
    assert found.ok


@pytest.mark.parametrize("slip", [0.0, 0.2])
def test_intact_robot_is_guided_everywhere_outside_the_goal(slip):
    found = solve(grid(slip=slip))
    guided = guided_set(found, jnp.argmax(found.q, axis=0), gamma=GAMMA)
    assert np.all(guided[~GOAL])


@pytest.mark.parametrize("slip", [0.0, 0.2])
@pytest.mark.parametrize("lost", [(0,), (1,), (2,), (3,)])
def test_one_lost_action_leaves_partial_guidance(lost, slip):
    healthy = solve(grid(slip=slip))
    policy = jnp.argmax(healthy.q, axis=0)
    guided = np.asarray(guided_set(solve(grid(lost, slip)), policy, gamma=GAMMA))[~GOAL]
    assert 0 < guided.sum() < guided.size, "neither empty nor everything"
    assert 25 <= guided.sum() <= 27, "of 48, as docs/ says"


@pytest.mark.parametrize("lost", [(), (0,), (1,), (2,), (3,), (0, 3)])
def test_guided_is_where_the_step_shortens_the_way(lost):
    policy = np.asarray(solve(grid()).q).argmax(0)
    steps = distances(lost)
    nearer = [steps[target(state, policy[state], lost)] < steps[state] for state in range(SIDE**2)]
    guided = np.asarray(guided_set(solve(grid(lost)), jnp.asarray(policy), gamma=GAMMA))
    np.testing.assert_array_equal(guided[~GOAL], np.array(nearer)[~GOAL])
    assert guided[GOAL].all()


def test_several_problems_at_once_equal_one_by_one():
    problems = [grid(), grid((1,))]
    wide = jax.jit(jax.vmap(partial(value_iteration, gamma=GAMMA)))(jax.tree.map(lambda *x: jnp.stack(x), *problems))
    for row, problem in enumerate(problems):
        np.testing.assert_allclose(wide.value[row], solve(problem).value, rtol=1e-5)
    assert wide.ok.all()


def test_faults_are_flagged_inside_jit():
    problem = grid()
    assert not solve(problem._replace(reward=problem.reward.at[0, 0].set(jnp.nan))).ok
    assert not jax.jit(partial(value_iteration, gamma=GAMMA, iterations=5))(problem).ok


@pytest.mark.parametrize(
    ("transition", "goal", "message"),
    [
        (np.ones((2, 3)), [True] * 3, "must be \\[A, S, S\\]"),
        (np.zeros((0, 3, 3)), [True] * 3, "must be \\[A, S, S\\]"),
        (np.ones((1, 2, 2)), [True, False], "summing to 1"),
        (np.full((1, 2, 2), np.nan), [True, False], "summing to 1"),
        (np.eye(2)[None], [False, False], "with a goal"),
        (np.eye(2)[None], [0, 1], "must be bool"),
    ],
)
def test_bad_problems_are_refused(transition, goal, message):
    with pytest.raises(ValueError, match=message):
        tabular(transition, np.array(goal))


@pytest.mark.parametrize("cluster", [None, np.repeat(np.arange(20), 3)])
def test_area_counts_pairs_with_ties_as_half(cluster):
    rng = np.random.default_rng(0)
    score, label = rng.integers(4, size=60) / 3.0, rng.random(60) < 0.4
    expected = np.mean([(a > b) + 0.5 * (a == b) for a in score[label] for b in score[~label]])
    found = auc(score, label, cluster)
    np.testing.assert_allclose(found.point, expected)
    assert found.low < expected < found.high
    flipped = auc(-score, label, cluster)
    np.testing.assert_allclose(flipped.point, 1.0 - expected)


def test_area_of_a_perfect_and_of_a_constant_score():
    label = np.arange(40) % 2 == 0
    np.testing.assert_allclose(auc(label.astype(float), label), 1.0)
    np.testing.assert_allclose(auc(np.zeros(40), label), 0.5)


def test_clusters_of_copies_do_not_narrow_the_interval():
    rng = np.random.default_rng(1)
    label = rng.random(60) < 0.5
    score = label + rng.normal(size=60) * 2.0
    alone = auc(score, label, np.arange(60))
    copied = auc(np.repeat(score, 10), np.repeat(label, 10), np.repeat(np.arange(60), 10))
    naive = auc(np.repeat(score, 10), np.repeat(label, 10))
    np.testing.assert_allclose(copied, alone, rtol=1e-9)
    assert naive.high - naive.low < 0.5 * (copied.high - copied.low)


def test_interval_covers_the_truth_about_as_often_as_it_says():
    rng, inside = np.random.default_rng(2), 0
    truth = 0.7602  # P(N(1, 1) > N(0, 1)) = Phi(1 / sqrt 2)
    for trial in range(200):
        label = np.arange(80) % 2 == 0
        found = auc(label + rng.normal(size=80), label, np.arange(80), 0.9, 400, trial)
        inside += found.low <= truth <= found.high
    assert 0.83 <= inside / 200 <= 0.96


@pytest.mark.parametrize(
    ("score", "label", "cluster", "message"),
    [
        ([0.1, 0.2], [True, True], None, "both outcomes"),
        ([], [], None, "both outcomes"),
        ([0.1, np.nan], [True, False], None, "not finite"),
        ([0.1, 0.2, 0.3], [True, False], None, "they must be"),
        ([0.1, 0.2], [1, 0], None, "they must be"),
        ([0.1, 0.2], [True, False], [0], "must name a cluster"),
        ([0.1, 0.2], [True, False], [0, 0], "two or more"),
    ],
)
def test_bad_scores_are_refused(score, label, cluster, message):
    label = np.array(label, dtype=None if label else bool)
    with pytest.raises(ValueError, match=message):
        auc(score, label, None if cluster is None else np.array(cluster))
