"""Where pi_B is worth following: the guided set exactly, for a tabular problem, and how well a score predicts it.

The second part is for a robot, where the set cannot be computed but two rollouts from one state can be compared.
"""

from typing import NamedTuple

import chex
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from srl_jax.statistics import Estimate, probability_of_improvement


class Tabular(NamedTuple):
    """A finite Markov decision process."""

    transition: jax.Array  # f32[A, S, S] P(s' | s, a), rows sum to 1
    reward: jax.Array  # f32[A, S] expected reward of the step


class Solution(NamedTuple):
    """The optimal values."""

    q: jax.Array  # f32[A, S]
    value: jax.Array  # f32[S] max_a q
    residual: jax.Array  # f32[] max |q - B q| / max(1, max |q|), with B Bellman's optimality operator
    ok: jax.Array  # bool[] finite, and the residual within the tolerance


def tabular(transition: ArrayLike, goal: ArrayLike) -> Tabular:
    """The sparse task of SRL (Raza et al. 2021), Sec. "Healthy Ensembles": reward 1 on reaching a goal, which absorbs.

    With ``V(goal) = 1 / (1 - gamma)``, a state t_g steps from the goal is worth ``gamma^(t_g - 1) / (1 - gamma)``.

    Args:
        transition: [A, S, S] P(s' | s, a); the goal's own rows are replaced by staying there.
        goal: bool[S], at least one of them.

    Raises:
        ValueError: the shapes disagree, a row is no distribution, or there is no goal.
    """
    p, goal = np.array(transition, np.float64), np.asarray(goal)
    if p.ndim != 3 or p.shape[1] != p.shape[2] or p.size == 0:
        raise ValueError(f"transition has shape {p.shape}; it must be [A, S, S] with A and S at least 1.")
    if goal.dtype != bool or goal.shape != p.shape[1:2] or not goal.any():
        raise ValueError(f"goal is {goal.dtype}{list(goal.shape)}; it must be bool[{p.shape[1]}] with a goal in it.")
    if not (np.all(p >= 0.0) and np.allclose(p.sum(-1), 1.0, atol=1e-5)):
        raise ValueError("transition must hold probabilities: non-negative and finite, each row [a, s] summing to 1.")
    p[:, goal] = np.eye(p.shape[1])[goal]
    return Tabular(jnp.asarray(p, jnp.float32), jnp.asarray(p @ goal, jnp.float32))


def value_iteration(
    problem: Tabular, *, gamma: jax.Array | float, tolerance: float = 1e-6, iterations: int = 10_000
) -> Solution:
    """Optimal values by value iteration, ``q <- r + gamma P max_a q``.

    Args:
        problem: see `tabular`; `vmap` over its leading axis solves several at once.
        gamma: f32[] in [0, 1).
        tolerance: residual at which to stop, relative to the largest value; float32 resolves about 1e-7.
        iterations: at most so many; the error that is left is ``residual / (1 - gamma)``.

    Returns:
        A solution; ``ok`` is false where it is not finite or has not converged.
    """
    chex.assert_rank([problem.transition, problem.reward], [3, 2])

    def bellman(q: jax.Array) -> jax.Array:
        return problem.reward + gamma * problem.transition @ jnp.max(q, axis=0)

    def residual(q: jax.Array, after: jax.Array) -> jax.Array:
        return jnp.max(jnp.abs(after - q)) / jnp.maximum(1.0, jnp.max(jnp.abs(after)))

    def unfinished(carry) -> jax.Array:
        _, left, count = carry
        return (left > tolerance) & (count < iterations)  # NaN compares false, and stops

    def improve(carry):
        q, _, count = carry
        after = bellman(q)
        return after, residual(q, after), count + 1

    start = jnp.zeros_like(problem.reward), jnp.float32(jnp.inf), jnp.int32(0)
    q, _, _ = jax.lax.while_loop(unfinished, improve, start)
    left = residual(q, bellman(q))
    ok = jnp.all(jnp.isfinite(q)) & (left <= 2.0 * tolerance)
    return Solution(q, jnp.max(q, axis=0), left, ok)


def guided_set(solution: Solution, policy: jax.Array, *, gamma: jax.Array | float, margin: float = 1e-4) -> jax.Array:
    """Where pi_B guides: ``{ s : Q*(s, pi_B(s)) > gamma V*(s) }`` (SRL, Raza et al. 2021, Sec. "Partially Guidance").

    Off the goal this says that pi_B's step leads to a better state: its discounted value exceeds that of standing
    still, ``gamma V*(s)``. A step that changes nothing does not guide, nor does any where the goal is out of reach
    (0 > 0). A goal is always in the set, since ``Q* = V* > gamma V*`` there; look outside it.

    Args:
        solution: optimal values of the damaged robot.
        policy: i32[S], pi_B's action in each state.
        gamma: f32[], as solved with.
        margin: least excess relative to V*, above the rounding and the residual of the solution.

    Returns:
        bool[S].
    """
    chex.assert_rank([solution.q, policy], [2, 1])
    taken = jnp.take_along_axis(solution.q, policy[None], axis=0)[0]
    return taken - gamma * solution.value > margin * solution.value


def _checked(
    score: ArrayLike, label: ArrayLike, cluster: ArrayLike | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    values, labels = np.asarray(score, np.float64), np.asarray(label)
    if values.ndim != 1 or labels.shape != values.shape or labels.dtype != bool:
        raise ValueError(
            f"score has shape {values.shape} and label is {labels.dtype}{list(labels.shape)}; "
            "they must be [n] and bool[n]."
        )
    if not np.all(np.isfinite(values)):
        raise ValueError(f"score holds {int((~np.isfinite(values)).sum())} values that are not finite; leave them out.")
    if labels.all() or not labels.any():
        raise ValueError(f"label has {int(labels.sum())} true of {labels.size}; the area needs both outcomes.")
    if cluster is None:
        return values, labels, np.arange(values.size)
    groups = np.asarray(cluster)
    if groups.shape != values.shape:
        raise ValueError(f"cluster has shape {groups.shape}; it must name a cluster for each of {values.size} scores.")
    return values, labels, np.unique(groups, return_inverse=True)[1]


def auc(
    score: ArrayLike,
    label: ArrayLike,
    cluster: ArrayLike | None = None,
    confidence: float = 0.95,
    resamples: int = 2000,
    seed: int = 0,
) -> Estimate:
    """Area under the receiver operating characteristic: P(a true pair scores above a false one), ties counting half.

    For predicting which of two rollouts from one state was better: the score is the critic's
    ``P[Q(s, pi_B) > Q(s, pi)]``, the label whether pi_B's was. Pairs that ended equal have no label: leave them out,
    and say how many. 1/2 is chance.

    Args:
        score: [n], finite; only its order matters.
        label: bool[n], both outcomes present.
        cluster: [n] names of what was drawn at random (an episode, a seed), where pairs share it. The bootstrap then
            resamples clusters; without, it resamples pairs within each label, as if they were independent
            (`statistics.probability_of_improvement`).
        confidence: mass of the interval.
        resamples: bootstrap draws; those of clusters that miss an outcome have no area and are left out.
        seed: of the bootstrap.

    Raises:
        ValueError: shapes differ, a score is not finite, only one outcome occurs, or fewer than two clusters.
    """
    values, labels, groups = _checked(score, label, cluster)
    true, false = values[labels], values[~labels]
    if cluster is None:
        return probability_of_improvement(true[:, None], false[:, None], confidence, resamples, seed)
    count = int(groups.max()) + 1
    if count < 2 or not 0.0 < confidence < 1.0:
        raise ValueError(f"cluster names {count} and confidence is {confidence}; two or more and a share are needed.")
    wins = (true[:, None] > false[None]) + 0.5 * (true[:, None] == false[None])
    member = np.eye(count)[groups]  # [n, clusters]
    won = member[labels].T @ wins @ member[~labels]  # [clusters of the true, clusters of the false]
    pairs = np.outer(member[labels].sum(0), member[~labels].sum(0))
    drawn = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), resamples).astype(np.float64)
    above, total = (np.einsum("rc,cd,rd->r", drawn, x, drawn, optimize=True) for x in (won, pairs))
    areas = above[total > 0] / total[total > 0]
    tail = 0.5 * (1.0 - confidence)
    low, high = np.quantile(areas, (tail, 1.0 - tail), method="nearest")
    return Estimate(float(wins.mean()), float(low), float(high))
