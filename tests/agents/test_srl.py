"""SRL: without its parts it is DDPG; each part against NumPy or a critic whose opinion is known."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, ensemble, posterior, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import DDPGConfig
from srl_jax.bayes import dropout
from tests.agents.reference import (
    ACTION,
    OBSERVATION,
    assert_same_movement,
    batch_of,
)
from tests.agents.small_srl import (
    FULL,
    KEY,
    OFF,
    SHARED,
    STATIC,
    STEP,
    convinced,
    high,
    run,
    start,
    student,
)

BASELINE = DDPGConfig(**SHARED)
baseline = jax.jit(ddpg.update, static_argnames=STATIC)


def signed(observation: jax.Array) -> jax.Array:
    """A teacher that is high in one half of the states and low in the other."""
    return 0.8 * jnp.sign(observation[:1]) * jnp.ones(ACTION)


# Without its parts


def test_update_without_its_parts_is_ddpg():
    mine, reference = start(), start()
    for seed in range(3):
        mine, metrics = run(mine, batch_of(seed), OFF, jax.random.key(seed), (high,))
        reference, expected = baseline(
            reference, batch_of(seed), KEY, config=BASELINE, hyper=from_config(BASELINE), step=STEP
        )
        for name in expected:
            assert metrics[name] == pytest.approx(float(expected[name]), rel=1e-5)
    assert metrics["p_guid"] == 0.0
    chex.assert_trees_all_close(mine, reference, atol=1e-6)


# The behaviour target


def test_behaviour_target_takes_the_better_action_under_the_online_critic():
    config, batch = dataclasses.replace(FULL, behaviour_target=True), batch_of()
    state = convinced(1.0)._replace(target_critic=start(5).critic)  # only the online critic may choose
    pick = jax.jit(lambda s: srl.next_action(s, batch, (signed,), config=config))
    own = student(state.target_actor, batch.next_observation)
    advice = jax.vmap(signed)(batch.next_observation)
    up = batch.next_observation[:, :1] > 0
    assert up.any() and not up.all()
    np.testing.assert_allclose(pick(state), np.where(up, advice, own), atol=1e-6)
    np.testing.assert_allclose(pick(convinced(-1.0)), np.where(up, own, advice), atol=1e-6)
    plain = jax.jit(lambda s: srl.next_action(s, batch, (signed,), config=FULL))(state)
    np.testing.assert_allclose(plain, own, atol=1e-6)


def test_behaviour_target_is_evaluated_by_the_target_critic():
    config, batch = dataclasses.replace(FULL, behaviour_target=True), batch_of()
    state = convinced(1.0)._replace(target_critic=convinced(3.0).critic)
    up = batch.next_observation[:, 0] > 0
    own = student(state.target_actor, batch.next_observation).sum(1)
    target = batch.reward + 0.97 * batch.discount * 3.0 * (4.0 + np.where(up, 1.6, own))
    error = 4.0 + batch.action.sum(1) - target
    _, metrics = run(state, batch, config, teachers=(signed,))
    assert metrics["critic_loss"] == pytest.approx(np.mean(error**2), rel=1e-4)


def test_ten_members_with_every_part_of_the_posterior_learn_and_act():
    ten = dict(critics=10, draws=20, guidance_draws=10, dropout_update=True, bootstrap=(0.5,), length_scale=(1.0,))
    config = dataclasses.replace(FULL, **ten, member_targets=True, prior_scale=1.0, hidden=(8, 8))
    state = jax.jit(lambda key: srl.init(key, OBSERVATION, ACTION, config=config))(KEY)
    after, metrics = run(state, batch_of(), config, teachers=(high,))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves((after, metrics)))
    moved = jax.tree.map(lambda a, b: np.any(a != b, axis=tuple(range(1, a.ndim))), after.critic, state.critic)
    assert all(any(leaf[k] for leaf in jax.tree.leaves(moved["online"])) for k in range(10))
    chex.assert_trees_all_equal(after.critic["prior"], state.critic["prior"])
    masks = posterior.sample(KEY, config=config, hyper=from_config(config))
    actions = jnp.stack([jnp.zeros(ACTION), high(jnp.zeros(OBSERVATION))])
    draws = dropout.q_draws(ensemble.critic_fn(config), after.critic, jnp.ones(OBSERVATION), actions, masks)
    assert draws.shape == (20, 2) and len(np.unique(draws[:10, 0])) == 10


# Lanes


def test_lanes_with_their_own_values_equal_separate_updates_and_do_not_see_each_other():
    parts = dict(bootstrap=(1.0, 0.5), length_scale=(0.0, 1.0), member_targets=True, prior_scale=1.0)
    config = dataclasses.replace(FULL, **parts)
    pile = lambda trees: jax.tree.map(lambda *x: jnp.stack(x), *trees)  # noqa: E731
    begin = jax.jit(lambda seed: srl.init(jax.random.key(seed), OBSERVATION, ACTION, config=config))
    lane_of = lambda tree, i: jax.tree.map(lambda x: x[i], tree)  # noqa: E731
    values = [
        dict(),
        dict(actor_lr=1e-3, dropout=0.5, guidance_weight=0.0),
        dict(critic_lr=1e-3, bootstrap=0.5, length_scale=1.0),
    ]
    hypers = pile([from_config(config, **value) for value in values])
    inputs = (
        pile(begin(s) for s in range(3)),
        pile(batch_of(s) for s in range(3)),
        jax.random.split(KEY, 3),
        hypers,
    )
    one = lambda s, b, k, h: srl.update(s, b, k, config=config, hyper=h, step=STEP, teachers=(high,))  # noqa: E731
    lanes = jax.jit(jax.vmap(one))
    wide, _ = lanes(*inputs)
    for i, value in enumerate(values):
        alone, _ = run(begin(i), batch_of(i), config, inputs[2][i], (high,), **value)
        for name in ("actor", "critic", "target_critic"):
            assert_same_movement(*(getattr(s, name) for s in (begin(i), lane_of(wide, i), alone)), 2e-2)
    swapped, _ = lanes(*jax.tree.map(lambda x: x[jnp.array([0, 2, 1])], inputs))
    chex.assert_trees_all_equal(lane_of(swapped, 0), lane_of(wide, 0))
