"""SRL: without its parts it is DDPG; each part against NumPy or a critic whose opinion is known."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.bayes import dropout
from srl_jax.types import Transition
from tests.agents.reference import convinced_critic, loop_draws

OBSERVATION, ACTION, BATCH = 4, 2, 6
SHARED = dict(
    critic_updates=1,
    tau=(0.01,),
    hidden=(8, 8),
    layer_norm=False,
    critics=2,
    freeze=(0.0,),
    actor_lr=(1e-2,),
    critic_lr=(1e-2,),
)
BASELINE = DDPGConfig(**SHARED)
FULL = SRLConfig(**SHARED, dropout=(0.3,), draws=8)
OFF = SRLConfig(**SHARED, select=False, guidance_weight=(0.0,), bootstrap=(1.0,), weight_decay=(0.0,))
STATIC = ("config", "teachers")
update = jax.jit(srl.update, static_argnames=STATIC)
init = jax.jit(lambda key: srl.init(key, OBSERVATION, ACTION, config=FULL))
baseline = jax.jit(ddpg.update, static_argnames=STATIC)
student = jax.jit(lambda actor, observation: ddpg.student(actor, observation, config=FULL))
critic_of = jax.jit(ddpg.critic_fn(FULL))
KEY, STEP = jax.random.key(0), jnp.float32(1e4)


def high(observation: jax.Array) -> jax.Array:
    """A teacher whose advice is a large sum of actions."""
    return 0.8 + 0.0 * observation[:ACTION]


def signed(observation: jax.Array) -> jax.Array:
    """A teacher that is high in one half of the states and low in the other."""
    return 0.8 * jnp.sign(observation[:1]) * jnp.ones(ACTION)


def batch_of(seed: int = 0) -> Transition:
    rng = np.random.default_rng(seed)
    draw = lambda *shape: rng.normal(size=(BATCH, *shape)).astype("f")  # noqa: E731
    discount = np.array([1, 1, 0, 1, 0, 1], "f")
    action = np.clip(draw(ACTION), -1, 1)
    return Transition(draw(OBSERVATION), action, draw(), discount, draw(OBSERVATION), np.zeros(BATCH, "f"))


def start(seed: int = 0) -> ddpg.AgentState:
    other = init(jax.random.key(seed + 100))
    return init(jax.random.key(seed))._replace(target_actor=other.actor, target_critic=other.critic)


def convinced(slope: float) -> ddpg.AgentState:
    """An agent whose members all believe ``Q(s, a) = slope (4 + sum(a))``."""
    state = start()
    critic = convinced_critic(state.critic, slope, OBSERVATION)
    return state._replace(critic=critic, target_critic=critic)


def run(state, batch, config, key=KEY, teachers=(), **overrides):
    hyper = from_config(config, **overrides)
    return update(state, batch, key, config=config, hyper=hyper, step=STEP, teachers=teachers)


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


# Guidance of the actor


@pytest.mark.parametrize("estimator", ["paired", "gaussian"])
def test_guidance_equals_a_loop_and_carries_no_gradient(estimator):
    config, state, batch = dataclasses.replace(FULL, estimator=estimator), start(), batch_of()
    hyper = from_config(config)
    action = jnp.asarray(batch.action)
    advice = jnp.stack([jnp.full_like(action, 0.8), -action], axis=1)

    def guided(critic, own, others):
        return srl.guidance(critic, batch, own, others, KEY, config=config, hyper=hyper, step=STEP)

    p = jax.jit(guided)(state.critic, action, advice)
    masks = dropout.sample_masks(KEY, config.hidden, (2, 2), hyper.dropout)
    for b in range(BATCH):
        q = loop_draws(critic_of, state.critic, batch.observation[b], [action[b], *advice[b]], masks)
        for n in (1, 2):
            d = jnp.asarray(q[:, n] - q[:, 0])
            exact = (
                np.mean((d > 0) + 0.5 * (d == 0))
                if estimator == "paired"
                else jax.scipy.stats.norm.cdf(d.mean() / d.std())
            )
            assert p[b, n - 1] == pytest.approx(float(exact), abs=1e-4)
    gradients = jax.jit(jax.grad(lambda *x: guided(*x).sum(), (0, 1, 2)))(state.critic, action, advice)
    assert all(np.all(leaf == 0) for leaf in jax.tree.leaves(gradients))


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
            return pull - ddpg.ensemble_q(after.critic, observations, own, config=FULL).mean()

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
    up = (batch.observation[:, :1] > 0).astype("f")
    assert up.any() and not up.all()
    np.testing.assert_array_equal(weigh(mean, 0, 1.0), up)
    np.testing.assert_array_equal(weigh(mean, 0, -1.0), 1 - up)
    annealed = dataclasses.replace(FULL, guidance_weighting="annealed", guidance_decay=(1_000.0,))
    for step, weight in ((0, 1.0), (250, 0.75), (1_000, 0.0), (2_000, 0.0)):
        np.testing.assert_allclose(weigh(annealed, step, -1.0), np.full((BATCH, 1), weight), atol=1e-6)


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


# Lanes


def test_lanes_with_their_own_values_equal_separate_updates_and_do_not_see_each_other():
    config = FULL
    pile = lambda trees: jax.tree.map(lambda *x: jnp.stack(x), *trees)  # noqa: E731
    lane_of = lambda tree, i: jax.tree.map(lambda x: x[i], tree)  # noqa: E731
    values = [
        dict(),
        dict(actor_lr=1e-3, dropout=0.5, guidance_weight=0.0),
        dict(critic_lr=1e-3, bootstrap=0.5),
    ]
    hypers = pile([from_config(config, **value) for value in values])
    inputs = (
        pile(start(s) for s in range(3)),
        pile(batch_of(s) for s in range(3)),
        jax.random.split(KEY, 3),
        hypers,
    )
    one = lambda s, b, k, h: srl.update(s, b, k, config=config, hyper=h, step=STEP, teachers=(high,))  # noqa: E731
    lanes = jax.jit(jax.vmap(one))
    wide, _ = lanes(*inputs)
    for i, value in enumerate(values):
        alone, _ = run(start(i), batch_of(i), config, inputs[2][i], (high,), **value)
        chex.assert_trees_all_close(lane_of(wide, i), alone, atol=5e-5)
    swapped, _ = lanes(*jax.tree.map(lambda x: x[jnp.array([0, 2, 1])], inputs))
    chex.assert_trees_all_equal(lane_of(swapped, 0), lane_of(wide, 0))
