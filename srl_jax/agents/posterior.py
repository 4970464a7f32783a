"""The posterior over SRL's critics: samples of it, each member's data, and the likelihood that fits it."""

import chex
import jax
import jax.numpy as jnp

from srl_jax.agents import ensemble, following
from srl_jax.agents.ensemble import critic_fn
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.interface import Metrics
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import dropout
from srl_jax.types import Params, Transition


def sample(key: jax.Array, *, config: SRLConfig, hyper: Hyper, proposals: int = 0) -> tuple:
    """Masks of `config.draws` posterior samples: f32[K, M / K, H] per layer ([K, M / K, N, H] unless shared)."""
    shape = (config.critics, config.draws // config.critics)
    if proposals and not config.shared_masks:
        shape = (*shape, proposals)
    return dropout.sample_masks(key, config.hidden, shape, hyper.dropout)


def draws(critic: Params, observation: jax.Array, actions: jax.Array, masks: tuple, *, config: SRLConfig) -> jax.Array:
    """Posterior draws f32[M, N] of what N proposals are worth at one state: of their actions, or of following them.

    Args:
        critic: ensemble parameters.
        observation: f32[O].
        actions: f32[N, A], the student's first.
        masks: as those of `dropout.q_draws`.
        config: static settings.
    """
    return following.own(dropout.q_draws(critic_fn(config), critic, observation, actions, masks), config=config)


def means(critic: Params, observation: jax.Array, actions: jax.Array, *, config: SRLConfig) -> jax.Array:
    """What the mean critic holds of N proposals, f32[N]; arguments as `draws`."""
    q = jax.vmap(lambda action: dropout.mean_q(critic_fn(config), critic, observation, action))(actions)
    return following.own(q, config=config)


def data_of_members(lot: jax.Array, share: jax.Array, members: int) -> jax.Array:
    """Which transitions are among the data of which member, 0 or 1: f32[K, B] from their lots f32[B].

    A member has a transition or has it not for as long as it is stored, since its lot decides: the bootstrap of Osband
    et al. (2016), of which each member sees another sample of the data.
    """
    draw = lambda seed: jax.random.uniform(jax.random.key(seed), (members,)) < share  # noqa: E731
    return jax.vmap(draw, out_axes=1)(lot.astype(jnp.uint32)).astype(jnp.float32)


def critic_loss(
    params: Params,
    batch: Transition,
    target: jax.Array,
    key: jax.Array,
    *,
    config: SRLConfig,
    hyper: Hyper,
    step: jax.Array,
) -> tuple[jax.Array, Metrics]:
    """The dropout likelihood (Gal & Ghahramani 2016), or AC-Teach's alpha-divergence (Li & Gal 2017), of all members.

    td: ``sum_k mean_b w_kb (Q_k(s, a; mask) - y_k)^2``; alpha: every member over its own J draws of masks,
    ``sum_k mean_b w_kb -(1/alpha) logsumexp_j[-(alpha tau / 2) (y_k - Q_kj)^2]``; w are its `data_of_members`. Where a
    critic has several heads, their likelihoods multiply: a sum over heads too.

    Args:
        params: ensemble parameters.
        batch: transitions, leading axis B.
        target: f32[K, B] of `ensemble.td_target`, f32[K, B, N] of `following.td_target`.
        key: random key.
        config: static settings.
        hyper: numeric settings.
        step: f32[] transitions seen so far by the lane.

    Returns:
        The loss f32[], weight decay included, and the metric ``critic_loss``, a mean over members without it.
    """
    loss = _divergence if config.critic_loss == "alpha" else _squared_error
    each = loss(params, batch, target, key, config=config, hyper=hyper)
    if config.values == "policy":
        each = jnp.sum(each, axis=-1)
    if min(config.bootstrap) < 1.0:
        each = each * data_of_members(batch.lot, hyper.bootstrap, config.critics)
    total = jnp.mean(each, axis=1).sum()  # members share no parameters: a sum, not a mean
    decay = weight_decay(ensemble.learned(params, config=config), config=config, hyper=hyper, step=step)
    return total + decay, {"critic_loss": total / config.critics}


def _squared_error(
    params: Params, batch: Transition, target: jax.Array, key: jax.Array, *, config: SRLConfig, hyper: Hyper
) -> jax.Array:
    """f32[K, B, ...], each transition under a mask of its own where `config.dropout_update` says so."""
    masks = None
    if config.dropout_update:
        masks = dropout.sample_masks(key, config.hidden, target.shape[:2], hyper.dropout)
    q = jax.vmap(critic_fn(config), (0, None, None, 0))(params, batch.observation, batch.action, masks)
    chex.assert_equal_shape([q, target])
    return jnp.square(q - target)


def _divergence(
    params: Params, batch: Transition, target: jax.Array, key: jax.Array, *, config: SRLConfig, hyper: Hyper
) -> jax.Array:
    """f32[K, B, ...]; a logsumexp across members would give nearly all of the gradient to the one that fits best."""
    masks = sample(key, config=config, hyper=hyper)
    over_batch = jax.vmap(dropout.q_draws, (None, None, 0, 0, None), 1)
    q = over_batch(critic_fn(config), params, batch.observation, batch.action[:, None], masks)
    q = q.reshape(-1, *target.shape)  # consecutive draws change the member first
    energy = -0.5 * hyper.alpha * hyper.precision * jnp.square(target[None] - q)
    return -jax.nn.logsumexp(energy, axis=0) / hyper.alpha


def weight_decay(weights: Params, *, config: SRLConfig, hyper: Hyper, step: jax.Array) -> jax.Array:
    """What the squares of the weights cost: a plain ``lambda ||phi||^2``, and what makes dropout variational.

    The latter is ``keep l^2 / (N tau)`` times the squares of the weight matrices for a squared error (Gal & Ghahramani
    2016, whose error has a factor 1/2) and ``keep l^2 / (2 N)`` for the alpha-divergence, which is tau / 2 times as
    large; N is the number of transitions seen.
    """
    decay = hyper.weight_decay * sum(jnp.sum(jnp.square(leaf)) for leaf in jax.tree.leaves(weights))
    if max(config.length_scale) == 0.0:
        return decay
    unit = 0.5 if config.critic_loss == "alpha" else 1.0 / hyper.precision
    rate = (1.0 - hyper.dropout) * jnp.square(hyper.length_scale) * unit / jnp.maximum(step, 1.0)
    kernels = [leaf for path, leaf in jax.tree.leaves_with_path(weights) if path[-1].key == "kernel"]
    return decay + rate * sum(jnp.sum(jnp.square(kernel)) for kernel in kernels)
