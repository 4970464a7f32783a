"""The healthy value V_B (`bayes.value`) at any state: a network with two heads under dropout, fitted to rollouts."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import chex
import flax.linen as nn
import jax
import jax.numpy as jnp
import optax

from srl_jax.bayes.dropout import sample_masks
from srl_jax.bayes.value import HealthyEpisodes, HealthyValue, combine
from srl_jax.types import Params


class Posterior(NamedTuple):
    """What the draws say, each field on its own: the mean value is not the product of the mean factors."""

    mean: HealthyValue
    std: HealthyValue
    ok: jax.Array  # bool[] every draw is finite


class Fit(NamedTuple):
    """A fitted network."""

    params: Params
    loss: jax.Array  # f32[] cross entropy over the last tenth of the updates, nats
    ok: jax.Array  # bool[] loss and parameters are finite


@dataclass(frozen=True)
class ValueConfig:
    """The value network and its training."""

    gamma: float = 0.97
    hidden: tuple[int, ...] = (64, 64)
    dropout: float = 0.1
    length_scale: float = 1.0
    """Prior length scale l of the variational weight decay, ``(1 - dropout) l^2 / (2 n)`` for n rows."""
    updates: int = 3000
    batch: int = 256
    learning_rate: float = 3e-3
    """Adam's, falling to 0 along a cosine."""
    tau: float = 0.02
    """Soft update of the network that values the ends of truncated episodes."""

    def __post_init__(self) -> None:
        if not 0.0 < self.gamma < 1.0 or not 0.0 <= self.dropout < 1.0:
            raise ValueError(f"gamma is {self.gamma} and dropout {self.dropout}; they must lie in (0, 1) and [0, 1).")
        for name in ("updates", "batch", "learning_rate", "tau"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} is {getattr(self, name)}; it must be positive.")


class ValueNetwork(nn.Module):
    """Logits of P(X_g) and of E[gamma^(t_g - 1) | X_g]: (f32[O], masks) -> f32[2]."""

    hidden: tuple[int, ...]

    @nn.compact
    def __call__(self, observation: jax.Array, masks: tuple | None = None) -> jax.Array:
        x = observation
        for layer, width in enumerate(self.hidden):
            x = nn.relu(nn.Dense(width)(x))
            x = x if masks is None else x * masks[layer]
        return nn.Dense(2)(x)


def _logits(config: ValueConfig, params: Params, observation: jax.Array, masks: tuple | None = None) -> jax.Array:
    return ValueNetwork(config.hidden).apply(params, observation, masks)  # type: ignore[return-value]


def targets(remaining: jax.Array, success: jax.Array, failure: jax.Array, end: jax.Array, gamma: float) -> jax.Array:
    """What an observed step says of (P(X_g), E[gamma^(t_g - 1) 1[X_g]]) at its state.

    A decided episode says it outright. A truncated one says that nothing happened for `remaining` steps, and hands
    on the estimate at its last observation (Pardo et al. 2018, "Time limits in reinforcement learning"). So truncation
    costs no bias if it depends on nothing but the observation and other episodes went on from where these ended. Where
    none did (a clock in the observation), the estimate at the end is extrapolated, and wrong as far as that is.

    From f32[] steps from the state to the episode's end (at least 1), its bool[] success and failure, and the estimates
    f32[2] at its last observation, to f32[2], the second at most the first.
    """
    discount = gamma**remaining
    reached = jnp.stack([jnp.ones_like(discount), discount / gamma])
    went_on = jnp.stack([end[0], discount * end[1]])
    return jnp.where(success, reached, jnp.where(failure, 0.0, went_on))


def cross_entropy(logits: jax.Array, target: jax.Array) -> jax.Array:
    """The loss of one step, f32[2] and f32[2] -> f32[] nats, least at P = E[y_0] and E[. | X_g] = E[y_1] / E[y_0].

    gamma read as the probability of being spared each further step makes three outcomes: reached while spared (y_1),
    reached later (y_0 - y_1), never (1 - y_0). The first head splits off the last, the second one the others.
    """
    yes, no = jax.nn.log_sigmoid(logits), jax.nn.log_sigmoid(-logits)
    reached = target[0] * yes[0] + (1.0 - target[0]) * no[0]
    return -(reached + target[1] * yes[1] + (target[0] - target[1]) * no[1])


def fit(data: HealthyEpisodes, key: jax.Array, *, config: ValueConfig) -> Fit:
    """Fits one network with dropout to healthy rollouts; `vmap` over keys makes an ensemble.

    Each key also resamples the episodes with replacement: steps of one episode are correlated, which the dropout
    posterior ignores and the spread over bootstrapped members shows.
    """
    chex.assert_rank([data.observation, data.length], [3, 1])
    init_key, episode_key, run_key = jax.random.split(key, 3)
    network = partial(_logits, config)
    params = ValueNetwork(config.hidden).init(init_key, data.observation[0, 0])
    index = jax.random.randint(episode_key, data.length.shape, 0, len(data.length))
    ends = jnp.cumsum(data.length[index])
    decay = (1.0 - config.dropout) * config.length_scale**2 / (2.0 * ends[-1])
    optimiser = optax.adam(optax.cosine_decay_schedule(config.learning_rate, config.updates))

    def entropy(params: Params, frozen: Params, row: jax.Array, masks: tuple) -> jax.Array:
        place = jnp.searchsorted(ends, row, side="right")
        episode, remaining = index[place], ends[place] - row
        length, success, failure = (x[episode] for x in data[1:])
        end = jnp.cumprod(jax.nn.sigmoid(network(frozen, data.observation[episode, length])))
        target = targets(remaining.astype(jnp.float32), success, failure, end, config.gamma)
        return cross_entropy(network(params, data.observation[episode, length - remaining], masks), target)

    def update(carry, step_key: jax.Array):
        params, frozen, state = carry
        row_key, mask_key = jax.random.split(step_key)
        rows = jax.random.randint(row_key, (config.batch,), 0, ends[-1])
        masks = sample_masks(mask_key, config.hidden, (config.batch,), jnp.float32(config.dropout))

        def loss(params: Params) -> tuple[jax.Array, jax.Array]:
            mean = jnp.mean(jax.vmap(entropy, (None, None, 0, 0))(params, frozen, rows, masks))
            return mean + decay * optax.tree.norm(params, squared=True), mean

        gradient, mean = jax.grad(loss, has_aux=True)(params)
        direction, state = optimiser.update(gradient, state)
        params = optax.apply_updates(params, direction)
        return (params, optax.incremental_update(params, frozen, config.tau), state), mean

    carry = params, params, optimiser.init(params)
    (params, _, _), losses = jax.lax.scan(update, carry, jax.random.split(run_key, config.updates))
    loss = jnp.mean(losses[-max(1, config.updates // 10) :])
    return Fit(params, loss, jnp.isfinite(loss) & jnp.isfinite(optax.tree.norm(params)))


def draws(params: Params, observation: jax.Array, masks: tuple, *, config: ValueConfig) -> HealthyValue:
    """Posterior draws of V_B and its factors at one state: K members under J masks each, f32[K * J] of each field.

    From parameters with a leading axis K, an observation f32[O], and masks f32[K, J, H] per hidden layer
    (`dropout.sample_masks`). Consecutive draws change the member first, as those of `dropout.q_draws`.

    Raises:
        ValueError: no draw was asked for.
    """
    if 0 in masks[0].shape:
        raise ValueError(f"masks have shape {masks[0].shape}; at least one member and one mask are needed.")
    over_members = jax.vmap(jax.vmap(partial(_logits, config), (None, None, 0)), (0, None, 0))
    logits = jnp.swapaxes(over_members(params, observation, masks), 0, 1).reshape(-1, 2)
    success, discount = jax.nn.sigmoid(logits).T
    return combine(success, discount, config.gamma)


def posterior(drawn: HealthyValue) -> Posterior:
    """Mean and standard deviation over the draws f32[M, ...] of each field."""
    ok = jnp.all(jnp.stack([jnp.all(jnp.isfinite(x)) for x in drawn]))
    mean, std = (HealthyValue(*(statistic(x, axis=0) for x in drawn)) for statistic in (jnp.mean, jnp.std))
    return Posterior(mean, std, ok)
