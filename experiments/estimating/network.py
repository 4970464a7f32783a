"""A learned estimator of the damage: how likely each damage makes one second of what was done and felt.

A classifier's probabilities are likelihoods up to a constant where its classes are alike in training (Bourlard & Morgan
1994): the hidden Markov model of `belief` takes them as it takes those of the observers. What none of the damages
makes likely has a class of its own, learned from damages that are not among them (outlier exposure, Hendrycks et al.
2019).
"""

from typing import NamedTuple

import flax.linen as nn
import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents.networks import Torso
from srl_jax.env import senses
from srl_jax.env.hexapod import ACTION_SIZE
from srl_jax.types import Params

Array = jax.Array | np.ndarray
WINDOW = 20  # control steps: one second
FEATURES = senses.SIZE + 2 * ACTION_SIZE
DOUBT = 1e-3  # chance that a window is one of which the network knows nothing
PAIR, HIDDEN = 48, (128, 64)  # widths: of what is seen in two neighbouring steps, and of what is made of all
_REST = np.array([0.0] * (senses.SIZE - 1) + [-1.0], np.float32)  # felt by a robot that stands
_SCALE = np.repeat(np.array([0.3, 1.0, 0.2], np.float32), (ACTION_SIZE, 3, 3))


class Estimator(NamedTuple):
    """What was learned of D damages and 'none of these', which is the last class."""

    params: Params
    log_share: jax.Array  # f32[D + 1] of the classes in training; -inf: it has never seen any
    temperature: jax.Array  # f32[] of the logits


class Network(nn.Module):
    """Windows f32[..., 20, 60] -> logits f32[..., D + 1]; every two neighbouring steps are seen by the same weights."""

    classes: int

    @nn.compact
    def __call__(self, window: jax.Array) -> jax.Array:
        pairs = jnp.concatenate([window[..., :-1, :], window[..., 1:, :]], axis=-1)
        seen = Torso((PAIR,), True)(pairs)
        seen = seen.reshape(*seen.shape[:-2], -1)
        return nn.Dense(self.classes)(Torso(HIDDEN, True)(seen))


def row(action: Array, felt: Array, answering: Array) -> jax.Array:
    """One control step f32[..., 60], of order one; 0 for a robot that stands and is whole.

    Args:
        action: f32[..., 18] taken.
        felt: f32[..., 24] after it (`senses.felt`).
        answering: bool[..., 18] after it.
    """
    rest, scale = (jnp.broadcast_to(x, felt.shape) for x in (_REST, _SCALE))
    return jnp.concatenate([(felt - rest) / scale, action, 1.0 - answering], axis=-1)


def standing() -> jax.Array:
    """The window f32[20, 60] of a robot that has not moved yet."""
    return jnp.zeros((WINDOW, FEATURES))


def log_probabilities(estimator: Estimator, window: jax.Array) -> jax.Array:
    """Of D damages and 'none of these' f32[..., D + 1], were they as frequent as in training; normalised."""
    found = logits(estimator.params, window, len(estimator.log_share)) / estimator.temperature
    return jax.nn.log_softmax(jnp.where(jnp.isfinite(estimator.log_share), found, -jnp.inf))


def logits(params: Params, window: jax.Array, classes: int) -> jax.Array:
    """The network's f32[..., classes] for windows f32[..., 20, 60]."""
    return Network(classes).apply(params, window)  # type: ignore[return-value]


def log_likelihood(estimator: Estimator, window: jax.Array, admitted: jax.Array) -> jax.Array:
    """Of D hypotheses and 'none of these', up to a constant: f32[D + 1].

    Damages are alike in training, so their probabilities are likelihoods up to a constant; healthy robots and none of
    these keep the shares that they had there. A damage that is not admitted is none of these, and what the network
    never saw is as likely as that.

    Args:
        estimator: as learned, of D damages.
        window: f32[20, 60].
        admitted: bool[D] hypotheses.
    """
    share, found = jnp.exp(estimator.log_share), jnp.exp(log_probabilities(estimator, window))
    likely = (1.0 - DOUBT) * found + DOUBT * share
    other = jnp.append(~admitted, True)
    none = jnp.sum(jnp.where(other, likely, 0.0))
    return jnp.log(jnp.where(other | (share == 0.0), none, likely))
