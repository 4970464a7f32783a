"""The critics: their targets against NumPy, and priors that never move but are always heard."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, ensemble, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.networks import Critic
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from tests.agents.reference import ACTION, OBSERVATION, assert_same_movement, batch_of

CONFIG = DDPGConfig(hidden=(8, 8), critics=2, critic_updates=1, freeze=(0.0,))
PRIOR = dataclasses.replace(CONFIG, prior_scale=3.0)
KEY = jax.random.key(0)


def critics(config: DDPGConfig, seed: int = 0):
    return ensemble.init(jax.random.key(seed), OBSERVATION, ACTION, config=config)


def loop_q(params, observation, action, config=CONFIG) -> np.ndarray:
    """Q f32[K, B] of each member alone."""
    one = [jax.tree.map(lambda x, k=k: x[k], params) for k in range(config.critics)]
    network = Critic(config.hidden, config.layer_norm)
    return np.array([[network.apply(m, s, a) for s, a in zip(observation, action, strict=True)] for m in one])


@pytest.mark.parametrize("own", [False, True])
def test_td_target_equals_numpy_and_stops_at_termination_only(own):
    config, batch, params = dataclasses.replace(CONFIG, member_targets=own), batch_of(), critics(CONFIG, 5)
    next_action = np.tanh(batch.next_observation[:, :ACTION])
    target = jax.jit(ensemble.td_target, static_argnames="config")(
        params, batch, next_action, config=config, hyper=from_config(config)
    )
    next_q = loop_q(params, batch.next_observation, next_action)
    if not own:
        next_q = next_q.mean(0, keepdims=True).repeat(2, 0)
    assert np.all((next_q[0] == next_q[1]) == (not own))
    np.testing.assert_allclose(target, batch.reward + 0.97 * batch.discount * next_q, rtol=1e-5, atol=1e-6)
    ends = batch.discount == 0
    np.testing.assert_array_equal(target[:, ends], batch.reward[None, ends].repeat(2, 0))
    assert np.all(target[:, ~ends] != batch.reward[None, ~ends]), "a time-out has discount 1 and bootstraps"


def test_a_members_own_target_moves_no_other_member():
    config, batch = dataclasses.replace(CONFIG, member_targets=True), batch_of()
    state = ddpg.init(KEY, OBSERVATION, ACTION, config=config)
    other = state._replace(target_critic=jax.tree.map(lambda x: x.at[1].add(0.5), state.target_critic))
    learn = lambda s, c: ddpg.update(s, batch, KEY, config=c, hyper=from_config(c), step=jnp.float32(1e4))[0]  # noqa: E731
    learn = jax.jit(learn, static_argnums=1)
    member = lambda tree, k: jax.tree.map(lambda x: x[k], tree)  # noqa: E731
    before, after, changed = (s.critic for s in (state, learn(state, config), learn(other, config)))
    assert_same_movement(member(before, 0), member(changed, 0), member(after, 0), 1e-5)
    together = learn(other, CONFIG).critic
    with pytest.raises(AssertionError):
        assert_same_movement(member(before, 0), member(together, 0), member(after, 0), 1e-2)


def test_without_a_prior_parameters_are_those_of_the_networks():
    assert set(critics(CONFIG)) == {"params"}
    chex.assert_trees_all_equal(critics(CONFIG), critics(PRIOR)["online"])


def test_a_prior_adds_its_networks_values_scaled_and_without_masks():
    params, batch = critics(PRIOR), batch_of()
    total = ensemble.q_values(params, batch.observation, batch.action, config=PRIOR)
    learned = loop_q(params["online"], batch.observation, batch.action)
    prior = loop_q(params["prior"], batch.observation, batch.action)
    np.testing.assert_allclose(total, learned + 3.0 * prior, rtol=1e-4, atol=1e-5)
    masks = tuple(jnp.zeros((2, width)) for width in PRIOR.hidden)
    over_members = jax.vmap(ensemble.critic_fn(PRIOR), (0, None, None, 0))
    masked = over_members(params, jnp.ones(OBSERVATION), jnp.ones(ACTION), masks)
    alone = loop_q(params["prior"], np.ones((1, OBSERVATION)), np.ones((1, ACTION)))[:, 0]
    np.testing.assert_allclose(masked, 3.0 * alone, rtol=1e-4, atol=1e-5)


def test_priors_are_of_order_one_and_differ():
    config = dataclasses.replace(PRIOR, hidden=(64, 64), critics=50)
    keys = jax.random.split(KEY, 2)
    observations, actions = jax.random.normal(keys[0], (20, OBSERVATION)), jax.random.uniform(keys[1], (20, ACTION))
    prior = critics(config)["prior"]
    values = jax.vmap(Critic(config.hidden, True).apply, (0, None, None))(prior, observations, actions)
    assert 0.7 < float(jnp.std(values, axis=0).mean()) < 1.3
    assert abs(np.corrcoef(values[:10]) - np.eye(10)).max() < 0.95


def test_the_actors_gradient_hears_the_prior():
    params = critics(PRIOR)
    q = lambda p, action: ensemble.q_values(p, jnp.ones(OBSERVATION), action, config=PRIOR)[0]  # noqa: E731
    slope = jax.grad(q, 1)(params, jnp.zeros(ACTION))
    without = jax.grad(q, 1)(params | {"prior": jax.tree.map(jnp.zeros_like, params["prior"])}, jnp.zeros(ACTION))
    assert np.abs(slope - without).max() > 0.05


@pytest.mark.parametrize("agent", [ddpg, srl])
def test_nothing_moves_a_prior(agent):
    every_part = dict(weight_decay=(1.0,), length_scale=(1.0,), dropout_update=True)
    config = PRIOR if agent is ddpg else SRLConfig(**vars(PRIOR), **every_part)
    state = agent.init(KEY, OBSERVATION, ACTION, config=config)
    assert jax.tree.structure(state.critic_optimiser.mu) == jax.tree.structure(state.critic["online"])
    settings = dict(config=config, hyper=from_config(config), step=jnp.float32(1e4))
    learn = jax.jit(lambda s, k: agent.update(s, batch_of(), k, **settings))
    after = state
    for key in jax.random.split(KEY, 3):
        after, _ = learn(after, key)
    chex.assert_trees_all_equal(after.critic["prior"], state.critic["prior"])
    chex.assert_trees_all_equal(after.target_critic["prior"], state.critic["prior"])
    for name in ("critic", "target_critic"):
        moved = jax.tree.map(lambda a, b: np.any(a != b), getattr(after, name)["online"], state.critic["online"])
        assert all(jax.tree.leaves(moved)), name
