"""SRL's guidance: who pulls at the actor, how hard, and that more teachers do not mean a weaker pull."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, ensemble, srl
from srl_jax.agents.hyper import from_config
from srl_jax.bayes import dropout
from tests.agents.reference import (
    ACTION,
    BATCH,
    assert_same_movement,
    batch_of,
    loop_draws,
)
from tests.agents.small_srl import (
    FULL,
    KEY,
    OFF,
    STEP,
    convinced,
    high,
    run,
    start,
    student,
)

critic_of = jax.jit(ensemble.critic_fn(FULL))


@pytest.mark.parametrize("estimator", ["paired", "gaussian"])
def test_guidance_equals_a_loop_and_carries_no_gradient(estimator):
    config, state, batch = dataclasses.replace(FULL, estimator=estimator), start(), batch_of()
    hyper = from_config(config)
    action = jnp.asarray(batch.action)
    advice = jnp.stack([jnp.full_like(action, 0.8), -action, jnp.zeros_like(action)], axis=1)

    def guided(critic, own, others):
        return srl.guidance(critic, batch, own, others, KEY, config=config, hyper=hyper, step=STEP)

    p, guide = jax.jit(guided)(state.critic, action, advice)
    masks = dropout.sample_masks(KEY, config.hidden, (2, 2), hyper.dropout)
    for b in range(BATCH):
        q = loop_draws(critic_of, state.critic, batch.observation[b], [action[b], *advice[b]], masks)
        best = 1 + int(np.argmax(q[:, 1:].mean(0)))
        d = jnp.asarray(q[:, best] - q[:, 0])
        exact = (
            np.mean((d > 0) + 0.5 * (d == 0)) if estimator == "paired" else jax.scipy.stats.norm.cdf(d.mean() / d.std())
        )
        assert guide[b] == best - 1
        assert p[b] == pytest.approx(float(exact), abs=1e-4)
    assert len(set(np.asarray(guide).tolist())) > 1, "which teacher is best depends on the state"
    gradients = jax.jit(jax.grad(lambda *x: guided(*x)[0].sum(), (0, 1, 2)))(state.critic, action, advice)
    assert all(np.all(leaf == 0) for leaf in jax.tree.leaves(gradients))


def low(observation: jax.Array) -> jax.Array:
    """A teacher whose advice is a small sum of actions."""
    return -high(observation)


@pytest.mark.parametrize("weighting", ["posterior", "mean", "annealed"])
@pytest.mark.parametrize("others", [(high,), (low,), (low, high, low)], ids=["twice", "worse", "both"])
def test_more_teachers_who_have_nothing_better_to_say_change_nothing(weighting, others):
    config = dataclasses.replace(FULL, guidance_weighting=weighting)
    alone, metrics = run(convinced(1e-3), batch_of(), config, teachers=(high,))
    more, same = run(convinced(1e-3), batch_of(), config, teachers=(high, *others))
    assert same["p_guid"] == pytest.approx(float(metrics["p_guid"]), abs=1e-6)
    zero = jax.tree.map(jnp.zeros_like, alone.actor)
    assert_same_movement(zero, more.actor_optimiser.mu, alone.actor_optimiser.mu, 1e-4)
    pull = run(convinced(1e-3), batch_of(), config, teachers=(high,), guidance_weight=0.0)[0].actor_optimiser.mu
    change = jax.tree.map(lambda a, b: jnp.abs(a - b).max(), pull, alone.actor_optimiser.mu)
    assert max(jax.tree.leaves(change)) > 0.01, "the pull is what is compared"


@pytest.mark.parametrize("weighting", ["posterior", "mean"])
def test_the_better_teacher_pulls_whatever_its_place(weighting):
    config = dataclasses.replace(FULL, guidance_weighting=weighting)
    alone, _ = run(convinced(1e-3), batch_of(), config, teachers=(high,))
    second, _ = run(convinced(1e-3), batch_of(), config, teachers=(low, high))
    zero = jax.tree.map(jnp.zeros_like, alone.actor)
    assert_same_movement(zero, second.actor_optimiser.mu, alone.actor_optimiser.mu, 1e-4)


def test_guidance_pulls_towards_a_teacher_unless_the_critic_is_against_it():
    batch, still = batch_of(), dict(critic_lr=0.0, dropout=0.0)
    advice = jnp.full((BATCH, ACTION), 0.8)

    def distance(state):
        return float(np.square(student(state.actor, batch.observation) - advice).sum(1).mean())

    def train(slope, weight):
        state, metrics = run(convinced(slope), batch, FULL, teachers=(high,), guidance_weight=weight, **still)
        for _ in range(14):
            state, _ = run(state, batch, FULL, teachers=(high,), guidance_weight=weight, **still)
        return distance(state), float(metrics["p_guid"])

    # An undecided critic has no slope, so that only the pull moves the actor.
    before = distance(convinced(0.0))
    pulled, p = train(0.0, 5.0)
    assert p == 0.5 and pulled < 0.2 * before
    assert train(0.0, 0.0)[0] == pytest.approx(before, abs=1e-6)
    # A teacher that is surely better pulls fully; one that is surely worse, not at all.
    assert train(1e-3, 5.0)[1] == 1.0
    away, p = train(-1e-3, 5.0)
    assert p == 0.0 and away == pytest.approx(train(-1e-3, 0.0)[0], abs=1e-6) and away > before


def test_actor_descends_the_guided_loss():
    state, batch, weight = start(), batch_of(), 3.0
    after, metrics = run(state, batch, FULL, teachers=(high,), guidance_weight=weight)
    masks_key, observations = jax.random.split(KEY)[1], jnp.asarray(batch.observation)
    advice, action = jnp.full((BATCH, ACTION), 0.8), student(state.actor, observations)
    p = np.zeros(BATCH)
    masks = dropout.sample_masks(masks_key, FULL.hidden, (2, 2), jnp.float32(0.3))
    for b in range(BATCH):
        q = loop_draws(critic_of, after.critic, batch.observation[b], [action[b], advice[b]], masks)
        p[b] = np.mean((q[:, 1] > q[:, 0]) + 0.5 * (q[:, 1] == q[:, 0]))
    assert metrics["p_guid"] == pytest.approx(p.mean(), abs=1e-6) and 0 < p.mean() < 1

    @jax.jit
    def gradient(actor, p):
        def loss(actor):
            own = ddpg.student(actor, observations, config=FULL)
            pull = weight * jnp.mean(p * jnp.square(own - advice).sum(1))
            return pull - ensemble.q_values(after.critic, observations, own, config=FULL).mean()

        return jax.grad(loss)(actor)

    expected = jax.tree.map(lambda g: 0.1 * g, gradient(state.actor, jnp.asarray(p, jnp.float32)))
    chex.assert_trees_all_close(after.actor_optimiser.mu, expected, atol=1e-6)  # Adam's first moment


def test_weight_zero_is_no_guidance():
    none = run(start(), batch_of(), OFF, teachers=(high,))[0]
    zero = run(start(), batch_of(), FULL, teachers=(high,), guidance_weight=0.0)[0]
    one = run(start(), batch_of(), FULL, teachers=(high,))[0]
    chex.assert_trees_all_close(none, zero, atol=1e-6)
    chex.assert_trees_all_equal(zero.critic, one.critic)
    assert np.any(zero.actor["params"]["action"]["bias"] != one.actor["params"]["action"]["bias"])


def test_guidance_by_the_mean_critic_is_its_verdict_and_annealed_guidance_asks_no_critic():
    batch, own, advice = batch_of(), jnp.full((BATCH, ACTION), 0.1), jnp.full((BATCH, 1, ACTION), 0.8)
    advice = advice * jnp.sign(batch.observation[:, :1, None])
    advice = jnp.concatenate([advice, 0.5 * advice], axis=1)  # the second teacher wants the same, but less of it
    weigh = lambda config, step, slope: srl.guidance(  # noqa: E731
        convinced(slope).critic,
        batch,
        own,
        advice,
        KEY,
        config=config,
        hyper=from_config(config, dropout=0.9),
        step=jnp.float32(step),
    )
    mean = dataclasses.replace(FULL, guidance_weighting="mean")
    up = (batch.observation[:, 0] > 0).astype("f")
    assert up.any() and not up.all()
    for slope, better in ((1.0, up), (-1.0, 1 - up)):
        p, guide = weigh(mean, 0, slope)
        np.testing.assert_array_equal(p, better)
        np.testing.assert_array_equal(guide, 1 - better)  # where both are worse, the one who wants less of it is best
    annealed = dataclasses.replace(FULL, guidance_weighting="annealed", guidance_decay=(1_000.0,))
    for step, weight in ((0, 1.0), (250, 0.75), (1_000, 0.0), (2_000, 0.0)):
        p, guide = weigh(annealed, step, -1.0)
        np.testing.assert_allclose(p, np.full(BATCH, weight), atol=1e-6)
        assert not guide.any(), "the first teacher, pi_B"
