"""The critic: an ensemble of K networks, beside each of which may stand a fixed random one.

With randomised priors (Osband et al. 2018, "Randomized prior functions for deep reinforcement learning") member k is
``Q_k = f_k + prior_scale p_k``: where there are no data, f_k does not learn to cancel p_k, and members disagree.
Parameters then are ``{"online": f, "prior": p}`` instead of f alone, and nothing but `init` ever changes the prior.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp

from srl_jax.agents.descent import track
from srl_jax.agents.hyper import Hyper
from srl_jax.agents.networks import UNIT_HEAD, Critic
from srl_jax.agents.settings import DDPGConfig
from srl_jax.types import Params, Transition


def init(key: jax.Array, observation_size: int, action_size: int, *, config: DDPGConfig, heads: int = 0) -> Params:
    """Fresh members, leaves with a leading axis K; each with `heads` values instead of one (see `networks.Critic`)."""
    network = Critic(config.hidden, config.layer_norm, heads=heads)
    online = _members(key, network, observation_size, action_size, config.critics)
    if config.prior_scale == 0.0:
        return online
    # The head of a network that learns starts near zero, where a prior of it would have no opinion.
    network, prior_key = Critic(config.hidden, config.layer_norm, UNIT_HEAD, heads), jax.random.fold_in(key, 1)
    return {
        "online": online,
        "prior": _members(prior_key, network, observation_size, action_size, config.critics),
    }


def _members(key: jax.Array, network: Critic, observation_size: int, action_size: int, count: int) -> Params:
    inputs = jnp.zeros(observation_size), jnp.zeros(action_size)
    return jax.vmap(lambda k: network.init(k, *inputs))(jax.random.split(key, count))


def critic_fn(config: DDPGConfig) -> Callable[..., jax.Array]:
    """The unbatched critic ``(params, observation, action, masks) -> f32[]`` of one member, its prior included.

    f32[heads] where its parameters have heads.
    """

    def network(params: Params, observation: jax.Array, action: jax.Array, masks: tuple | None = None) -> jax.Array:
        own = params["params"]
        heads = own["heads"]["bias"].shape[-1] if "heads" in own else 0
        critic = Critic(config.hidden, config.layer_norm, heads=heads)
        return critic.apply(params, observation, action, masks)  # type: ignore[return-value]

    if config.prior_scale == 0.0:
        return network

    def with_prior(params: Params, observation: jax.Array, action: jax.Array, masks: tuple | None = None):
        learned = network(params["online"], observation, action, masks)
        return learned + config.prior_scale * network(params["prior"], observation, action)

    return with_prior


def learned(params: Params, *, config: DDPGConfig) -> Params:
    """What of a critic's parameters learns: all but the prior."""
    return params if config.prior_scale == 0.0 else params["online"]


def with_learned(params: Params, new: Params, *, config: DDPGConfig) -> Params:
    """A critic's parameters with others in place of what learns."""
    return new if config.prior_scale == 0.0 else params | {"online": new}


def q_values(params: Params, observation: jax.Array, action: jax.Array, *, config: DDPGConfig) -> jax.Array:
    """Q of every member without masks: f32[..., O], f32[..., A] -> f32[K, ...]."""
    return jax.vmap(critic_fn(config), (0, None, None))(params, observation, action)


def td_target(
    target_critic: Params, batch: Transition, next_action: jax.Array, *, config: DDPGConfig, hyper: Hyper
) -> jax.Array:
    """What every member learns to predict for a batch: f32[K, B].

    ``r + gamma * discount * mean_k Q'_k(s', a')``, the same for all; with `config.member_targets`, Q'_k in place of the
    mean, so that what members disagree on at s' reaches s (Osband et al. 2016).
    """
    next_q = q_values(target_critic, batch.next_observation, next_action, config=config)
    return bootstrap(next_q, batch, config=config, hyper=hyper)


def bootstrap(next_q: jax.Array, batch: Transition, *, config: DDPGConfig, hyper: Hyper) -> jax.Array:
    """`td_target` from the target members' values f32[K, B] of what comes next."""
    if not config.member_targets:
        next_q = jnp.broadcast_to(jnp.mean(next_q, axis=0, keepdims=True), next_q.shape)
    return batch.reward[None] + hyper.gamma * batch.discount[None] * next_q


def follow(online: Params, target: Params, *, config: DDPGConfig, hyper: Hyper) -> Params:
    """Soft update of the target critic; its prior is the online one's and stays."""
    new = track(learned(online, config=config), learned(target, config=config), hyper=hyper)
    return with_learned(target, new, config=config)
