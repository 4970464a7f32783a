"""What robots felt while they walked, and how likely bank and network made every damage at each step.

The bank's robots walk as `recovery.run` lets them, without putting damages together; the network is asked afterwards
about the very same steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.estimating import network, training
from experiments.estimating.network import Estimator
from experiments.estimating.walks import Walks
from experiments.recovering.rows import Case
from srl_jax.atlas import belief as beliefs
from srl_jax.atlas import recovery
from srl_jax.atlas.belief import Belief, Likelihood
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.robots import CRobot
from srl_jax.env.damage_names import HEALTHY
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.env.senses import Senses

STRIKE = (20, 40)  # control steps of healthy walking before the damage
HAZARD = Likelihood._field_defaults["hazard"]


@dataclass
class Recorded(CRobot):
    """A robot whose senses are kept."""

    heard: list[Senses] = field(default_factory=list)

    def reset(self) -> Senses:
        """As `CRobot`."""
        self.heard = [super().reset()]
        return self.heard[0]

    def step(self, action: np.ndarray) -> Senses:
        """As `CRobot`."""
        self.heard.append(super().step(action))
        return self.heard[-1]


class Told(NamedTuple):
    """N robots, T control steps, K = D + 1 hypotheses, the last of which is 'none of these'."""

    damages: tuple[str, ...]  # of each robot
    strike: np.ndarray  # i32[N]; T of a robot that stays healthy
    truth: np.ndarray  # i32[T, N] index of the hypothesis that is true
    bank: np.ndarray  # f32[T, N, K] log-likelihoods, up to a constant of each step
    walks: Walks  # what each belief could be founded on
    admitted: np.ndarray  # bool[D]


def told(atlas: Atlas, lots: Sequence[Case], seconds: float, seed: int, without: Sequence[str] = ()) -> Told:
    """Walks robots for so long.

    Args:
        atlas: see `file.load`.
        lots: what each robot goes through.
        seconds: of robot time.
        seed: of strikes and noise.
        without: damages of which the robots have neither hypotheses nor policies.
    """
    random = np.random.default_rng(seed)
    bodies = [Recorded(lot.damage, int(random.integers(*STRIKE)), seed + i, lot.world) for i, lot in enumerate(lots)]
    own = recovery.scope(atlas, without)
    admitted = np.asarray(own.damages)
    story = recovery.run(
        atlas, bodies, seconds=seconds, scopes=lambda step: [own] * len(bodies), compose=False, learn=False
    )
    count = len(atlas.damages)
    log_belief = np.concatenate([story.log_belief[..., :count], story.log_belief[..., -1:]], axis=-1)
    index = [atlas.damages.index(name) if name in atlas.damages and name not in without else count
             for name in (lot.damage for lot in lots)]  # fmt: skip
    strike = np.array([len(log_belief) if body.damage == HEALTHY else body.strike for body in bodies])
    struck = np.arange(len(log_belief))[:, None] > strike
    walks = _walks(bodies, story.action)
    truth = np.where(struck, np.array(index), 0)
    return Told(tuple(lot.damage for lot in lots), strike, truth, evidence(log_belief, admitted), walks, admitted)


def _walks(bodies: Sequence[Recorded], action: np.ndarray) -> Walks:
    """What led to each belief: before the first one a robot has not acted yet."""
    steps = len(action)
    before = np.concatenate([np.zeros((1, len(bodies), ACTION_SIZE), np.float32), action[:-1]])
    each = [jax.tree.map(lambda *leaves: np.stack(leaves), *body.heard[:steps]) for body in bodies]
    felt = np.stack([np.concatenate([own.joints, own.gyroscope, own.gravity], axis=1) for own in each])
    answering = np.stack([own.answering for own in each])
    return Walks(before.swapaxes(0, 1), felt, answering, np.zeros(felt.shape[:2], np.int32))


def asked(estimator: Estimator, told: Told) -> np.ndarray:
    """The network's log-likelihoods f32[T, N, K] of all steps of all robots."""
    every, admitted = training.every_window(told.walks), jnp.asarray(told.admitted)
    return np.asarray(_asked(estimator, every, admitted)).swapaxes(0, 1)


@jax.jit
def _asked(estimator: Estimator, windows: jax.Array, admitted: jax.Array) -> jax.Array:
    return jax.vmap(jax.vmap(lambda window: network.log_likelihood(estimator, window, admitted)))(windows)


def evidence(log_belief: np.ndarray, admitted: np.ndarray) -> np.ndarray:
    """The log-likelihoods that made a bank believe this f32[T, N, K]: its recursion, solved for them."""
    even = np.asarray(beliefs.even(jnp.asarray(admitted)))
    start = np.broadcast_to(np.asarray(beliefs.prior(jnp.asarray(even)).log), (1, *log_belief.shape[1:]))
    before = np.concatenate([start, log_belief[:-1]])
    with np.errstate(invalid="ignore"):
        predicted = np.logaddexp(np.log1p(-HAZARD) + before, np.log(HAZARD) + even)
        return np.where(np.isfinite(even), log_belief - predicted, 0.0).astype(np.float32)


@jax.jit
def believed(likelihood: jax.Array, admitted: jax.Array) -> jax.Array:
    """The beliefs f32[T, N, K] that log-likelihoods lead to, by the recursion of `belief`."""
    even = beliefs.even(admitted)

    def advance(belief: Belief, row: jax.Array) -> tuple[Belief, jax.Array]:
        after = beliefs.update(belief, row, even, HAZARD)
        return after, after.log

    one = lambda rows: jax.lax.scan(advance, beliefs.prior(even), rows)[1]  # noqa: E731
    return jax.vmap(one, 1, 1)(likelihood)
