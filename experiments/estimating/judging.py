"""How good beliefs are: who is named, which policy that leads to, how likely the truth was, and whether shares hold."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.estimating.stories import Told, believed
from srl_jax.atlas import trials
from srl_jax.atlas.file import Atlas
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.statistics import stratified_interval

LOOKS = (0.25, 0.5, 1.0, 2.0)  # seconds after the damage
WEIGHTS = (0.0, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)  # of the network's log-likelihoods
TEMPERS = (0.4, 0.5, 0.6, 0.75, 0.9, 1.0)  # weights of the bank's
BINS = 10
LIKE = 0.9  # share of the best policy's worth at which another counts as right


class Weights(NamedTuple):
    """Of the log-likelihoods of bank and network."""

    bank: float
    network: float


def beliefs_of(told: Told, network: np.ndarray, weights: Weights) -> np.ndarray:
    """Log-beliefs f32[T, N, K] of a log-linear pool of the bank and a network's log-likelihoods f32[T, N, K]."""
    pooled = weights.bank * told.bank + weights.network * network
    return np.asarray(believed(jnp.asarray(pooled), jnp.asarray(told.admitted)))


def at_a_glance(told: Told, network: np.ndarray) -> np.ndarray:
    """Log-beliefs f32[T, N, K] of the network alone, which forgets what is older than its window.

    As many robots are healthy as all others together, and as many damaged ones have one damage as another.
    """
    admitted = np.append(told.admitted, True)
    prior = np.where(admitted, 0.5 / (admitted.sum() - 1), 0.0)
    prior[0] = 0.5
    with np.errstate(divide="ignore"):
        joint = network + np.log(prior)
    return joint - np.logaddexp.reduce(joint, axis=-1, keepdims=True)


def log_score(told: Told, log_belief: np.ndarray) -> np.ndarray:
    """Mean log-probability of the truth over all steps, of every robot f32[N]."""
    return np.take_along_axis(log_belief, told.truth[..., None], axis=-1)[..., 0].mean(axis=0)


def fitted(stories: Sequence[tuple[Told, np.ndarray]], choices: Sequence[Weights]) -> Weights:
    """The weights that make the truth likeliest; each story is with what the network says of it."""
    scores = [
        np.mean([log_score(told, beliefs_of(told, said, own)).mean() for told, said in stories]) for own in choices
    ]
    return choices[int(np.argmax(scores))]


def at(told: Told, rows: np.ndarray, seconds: float) -> np.ndarray:
    """The rows [N, ...] of every robot so long after its damage."""
    step = np.minimum(told.strike + round(seconds * CONTROL_HZ), len(rows) - 1)
    return rows[step, np.arange(len(step))]


def named(told: Told, log_belief: np.ndarray, seconds: float) -> np.ndarray:
    """Who thought of the truth first, bool[N]; among the damages that it is of, or of none of these."""
    truth = at(told, told.truth, seconds)
    return np.argmax(at(told, log_belief, seconds), axis=-1) == truth


@jax.jit
def _chosen(log_belief: jax.Array, value: jax.Array) -> jax.Array:
    return jax.vmap(lambda own: jnp.argmax(trials.expect(own, value).mean))(log_belief)


def right_policy(atlas: Atlas, told: Told, log_belief: np.ndarray, seconds: float) -> float:
    """How often a belief leads to a policy within 10 % of the best one by the matrix, under damages of the atlas."""
    truth = at(told, told.truth, seconds)
    known = truth < atlas.value.shape[1]
    if not known.any():
        return np.nan
    policy = np.asarray(_chosen(at(told, log_belief, seconds), jnp.asarray(atlas.value)))[known]
    worth = atlas.value[:, truth[known]]
    return float(np.mean(worth[policy, np.arange(len(policy))] >= LIKE * worth.max(axis=0)))


def alarms(told: Told, log_belief: np.ndarray) -> np.ndarray:
    """Who took itself for damaged at some step before it was, bool[N]."""
    doubted = (log_belief[..., 0] < np.log(0.5)) & (np.arange(len(log_belief))[:, None] <= told.strike)
    return doubted.any(axis=0)


def reliability(stories: Sequence[Told], log_beliefs: Sequence[np.ndarray]) -> tuple[float, list[tuple]]:
    """Expected calibration error of the likeliest hypothesis' probability, and (claimed, right, share) of every bin.

    Over all steps from the damage on, of stories whose beliefs these are.
    """
    sure, right = [], []
    for told, log_belief in zip(stories, log_beliefs, strict=True):
        after = np.arange(len(log_belief))[:, None] > told.strike
        sure.append(np.exp(log_belief.max(axis=-1))[after])
        right.append((log_belief.argmax(axis=-1) == told.truth)[after])
    claimed, found = np.concatenate(sure), np.concatenate(right)
    which = np.minimum((claimed * BINS).astype(int), BINS - 1)
    bins = [(claimed[which == b].mean(), found[which == b].mean(), np.mean(which == b)) for b in np.unique(which)]
    return float(sum(share * abs(own - was) for own, was, share in bins)), bins


def gain(own: np.ndarray, others: np.ndarray) -> str:
    """The mean difference robot by robot, and its 95 % interval."""
    gained = (np.asarray(own, float) - np.asarray(others, float))[:, None]
    low, high = stratified_interval(gained, np.mean)
    return f"{gained.mean():+.3f} [{low:+.3f}, {high:+.3f}]"


def table(atlas: Atlas, told: Told, ways: Mapping[str, np.ndarray]) -> list[str]:
    """One line for each way to believe (name -> log-beliefs) about damages of the atlas."""
    lines = []
    for way, log_belief in ways.items():
        cells = []
        for seconds in LOOKS:
            score = np.take_along_axis(at(told, log_belief, seconds), at(told, told.truth, seconds)[:, None], -1)
            first, good = named(told, log_belief, seconds), right_policy(atlas, told, log_belief, seconds)
            cells.append(f"{first.mean():.2f} {good:.2f} {score.mean():+.2f}")
        lines.append(f"  {way:<8} " + " | ".join(cells) + f" | alarm {share(alarms(told, log_belief))}")
    return lines


def strangers(told: Told, ways: Mapping[str, np.ndarray]) -> list[str]:
    """One line for each way to believe about damages that nobody foresaw: sure of none, of a wrong one, of healthy."""
    lines = []
    for way, log_belief in ways.items():
        cells = []
        for seconds in LOOKS:
            half = np.exp(at(told, log_belief, seconds)) > 0.5
            parts = half[:, -1], half[:, 1:-1].any(axis=1), half[:, 0]
            cells.append(" ".join(f"{part.mean():.2f}" for part in parts))
        lines.append(f"  {way:<8} " + " | ".join(cells) + f" | score {log_score(told, log_belief).mean():+.2f}")
    return lines


def share(of: np.ndarray) -> str:
    """A mean over robots and its 95 % interval."""
    rows = np.asarray(of, float)[:, None]
    low, high = stratified_interval(rows, np.mean)
    return f"{np.mean(rows):.3f} [{low:.3f}, {high:.3f}]"
