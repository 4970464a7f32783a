"""DDPG's pieces against NumPy, its clocks, and its lanes."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from srl_jax.agents import ddpg, ensemble
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import DDPGConfig
from srl_jax.bayes import controller
from srl_jax.types import ActState
from tests.agents.reference import ACTION, BATCH, OBSERVATION, assert_same_movement, batch_of

CONFIG = DDPGConfig(
    hidden=(8, 8),
    critics=2,
    critic_updates=1,
    tau=(0.01,),
    batch=BATCH,
    freeze=(100.0,),
    actor_lr=(1e-2,),
    critic_lr=(1e-2,),
)
HYPER = from_config(CONFIG)
update = jax.jit(ddpg.update, static_argnames=("config", "teachers"))
act = jax.jit(ddpg.act, static_argnames=("config", "teachers"))
init = jax.jit(lambda key: ddpg.init(key, OBSERVATION, ACTION, config=CONFIG))
student = jax.jit(ddpg.student, static_argnames="config")
KEY, LATE = jax.random.key(0), jnp.float32(1e6)


def start(seed: int = 0) -> ddpg.AgentState:
    """An agent whose targets differ from its online networks."""
    other = init(jax.random.key(seed + 100))
    return init(jax.random.key(seed))._replace(target_actor=other.actor, target_critic=other.critic)


def idle() -> ActState:
    return ActState(jnp.zeros(ACTION), controller.init())


def member(params, k: int):
    return jax.tree.map(lambda leaf: leaf[k], params)


def loop_q(params, observation, action) -> np.ndarray:
    critic = ensemble.critic_fn(CONFIG)
    return np.array(
        [[critic(member(params, k), s, a) for s, a in zip(observation, action, strict=True)] for k in range(2)]
    )


def run(state, batch, hyper=HYPER, step=LATE):
    return update(state, batch, KEY, config=CONFIG, hyper=hyper, step=step)


def moved(before, after) -> bool:
    return any(np.any(a != b) for a, b in zip(jax.tree.leaves(before), jax.tree.leaves(after), strict=True))


def test_targets_start_at_the_networks_and_members_differ():
    state = init(KEY)
    chex.assert_trees_all_equal(state.target_actor, state.actor)
    chex.assert_trees_all_equal(state.target_critic, state.critic)
    assert moved(member(state.critic, 0), member(state.critic, 1))
    assert all(leaf.shape[0] == 2 for leaf in jax.tree.leaves(state.critic))


def test_an_adopted_actor_is_online_and_target_in_buffers_of_their_own():
    state, actor = start(), init(jax.random.key(7)).actor
    adopted = ddpg.adopt(state, actor)
    chex.assert_trees_all_equal(adopted.actor, actor)
    chex.assert_trees_all_equal(adopted.target_actor, actor)
    shared = zip(jax.tree.leaves(adopted.actor), jax.tree.leaves(adopted.target_actor), strict=True)
    assert not any(a is b for a, b in shared), "donated buffers must not alias"
    chex.assert_trees_all_equal(adopted.critic, state.critic)


def test_update_equals_a_reference_with_optax():
    state, batch = start(), batch_of()
    (after, metrics), (gamma, tau) = run(state, batch), (0.97, 0.01)
    next_action = student(state.target_actor, batch.next_observation, config=CONFIG)
    next_q = loop_q(state.target_critic, batch.next_observation, next_action).mean(0)
    target = jnp.asarray(batch.reward + gamma * batch.discount * next_q)
    critic, adam = jax.vmap(ensemble.critic_fn(CONFIG), (None, 0, 0)), optax.adam(1e-2)

    @jax.jit
    def fit(params):
        loss = lambda p: jnp.mean((critic(p, batch.observation, batch.action) - target) ** 2)  # noqa: E731
        value, gradient = jax.value_and_grad(loss)(params)
        return value, optax.apply_updates(params, adam.update(gradient, adam.init(params))[0])

    losses, members = zip(*(fit(member(state.critic, k)) for k in range(2)), strict=True)
    for k in range(2):
        assert_same_movement(member(state.critic, k), member(after.critic, k), members[k], 1e-3)
    assert metrics["critic_loss"] == pytest.approx(float(sum(losses)) / 2, rel=1e-5)

    @jax.jit
    def climb(params):
        def loss(p):
            action = ddpg.student(p, batch.observation, config=CONFIG)
            return -sum(critic(m, batch.observation, action).mean() for m in members) / 2

        value, gradient = jax.value_and_grad(loss)(params)
        return value, gradient, optax.apply_updates(params, adam.update(gradient, adam.init(params))[0])

    value, gradient, actor = climb(state.actor)
    # Adam's first step is all but the gradient's sign, its first moment the gradient itself.
    nothing, tenth = jax.tree.map(jnp.zeros_like, gradient), jax.tree.map(lambda g: 0.1 * g, gradient)
    assert_same_movement(nothing, after.actor_optimiser.mu, tenth, 1e-3)
    assert_same_movement(state.actor, after.actor, actor, 1e-2)
    assert metrics["q"] == pytest.approx(-float(value), abs=1e-5)
    expected = jax.tree.map(lambda new, old: (1 - tau) * old + tau * new, after.critic, state.target_critic)
    assert_same_movement(state.target_critic, after.target_critic, expected, 1e-3)
    expected = jax.tree.map(lambda new, old: (1 - tau) * old + tau * new, after.actor, state.target_actor)
    assert_same_movement(state.target_actor, after.target_actor, expected, 1e-3)


@pytest.mark.parametrize(("step", "learns"), [(0.0, False), (99.0, False), (100.0, True), (1e5, True)])
def test_the_actor_is_frozen_at_first_while_the_critic_learns(step, learns):
    state = start()
    after, _ = run(state, batch_of(), step=jnp.float32(step))
    assert moved(state.actor, after.actor) == learns
    assert moved(state.critic, after.critic)


def test_members_learn_apart_where_nothing_is_bootstrapped():
    batch, state = batch_of(discount=np.zeros(BATCH, "f")), start()
    other = state._replace(critic=jax.tree.map(lambda leaf: leaf.at[1].add(0.5), state.critic))
    after, changed = run(state, batch)[0], run(other, batch)[0]
    assert_same_movement(member(state.critic, 0), member(changed.critic, 0), member(after.critic, 0), 1e-4)


def test_critic_fits_a_batch():
    state, batch = start(), batch_of(discount=np.zeros(BATCH, "f"))
    losses = []
    for _ in range(150):
        state, metrics = run(state, batch)
        losses.append(float(metrics["critic_loss"]))
    assert losses[-1] < 0.05 * losses[0]


def test_actor_climbs_its_critic():
    state, batch = start(), batch_of()
    frozen = HYPER._replace(critic_lr=jnp.float32(0.0))
    before = run(state, batch, frozen)[1]["q"]
    for _ in range(30):
        state, metrics = run(state, batch, frozen)
    assert metrics["q"] > before


def test_acting_adds_noise_to_the_student_and_ignores_teachers():
    state, observation = start(), jnp.ones(OBSERVATION)
    quiet = HYPER._replace(noise=jnp.float32(0.0))
    own = student(state.actor, observation, config=CONFIG)
    keywords = dict(config=CONFIG, step=LATE)
    action, after = act(state, idle(), observation, KEY, hyper=quiet, teachers=(jnp.sin,), **keywords)
    np.testing.assert_allclose(action, own, atol=1e-6)
    assert after.guidance.choice == 0
    action, after = act(state, idle(), observation, KEY, hyper=HYPER, **keywords)
    np.testing.assert_allclose(action, jnp.clip(own + 0.25 * after.noise, -1, 1), atol=1e-6)
    loud, _ = act(state, idle(), observation, KEY, hyper=HYPER._replace(noise=jnp.float32(1e3)), **keywords)
    assert np.all(np.abs(loud) == 1.0)


def test_lanes_with_their_own_rates_equal_separate_updates_and_do_not_see_each_other():
    states = jax.tree.map(lambda *x: jnp.stack(x), *(start(s) for s in range(3)))
    batches = jax.tree.map(lambda *x: jnp.stack(x), *(batch_of(s) for s in range(3)))
    hypers = jax.tree.map(lambda x: jnp.tile(x, 3), HYPER)._replace(critic_lr=jnp.array([1e-2, 1e-3, 0.0]))
    one = lambda s, b, h: ddpg.update(s, b, KEY, config=CONFIG, hyper=h, step=LATE)  # noqa: E731
    lanes = jax.jit(jax.vmap(one))
    wide, _ = lanes(states, batches, hypers)
    for lane in range(3):
        alone, _ = run(start(lane), batch_of(lane), member(hypers, lane))
        for name, tolerance in (("actor", 2e-2), ("critic", 1e-3), ("target_critic", 1e-3)):
            if name == "critic" and lane == 2:
                continue  # its rate is 0
            before, after, expected = (getattr(s, name) for s in (start(lane), member(wide, lane), alone))
            assert_same_movement(before, after, expected, tolerance)
    chex.assert_trees_all_equal(member(wide, 2).critic, start(2).critic)
    swapped = jax.tree.map(lambda x: x[jnp.array([0, 2, 1])], (states, batches, hypers))
    other, _ = lanes(*swapped)
    chex.assert_trees_all_equal(member(other, 0), member(wide, 0))


def test_several_critic_steps_are_single_ones_in_turn():
    still = HYPER._replace(actor_lr=jnp.float32(0.0))
    double = dataclasses.replace(CONFIG, critic_updates=2)
    first, second = batch_of(seed=1), batch_of(seed=2)
    both = jax.tree.map(lambda a, b: np.concatenate([a, b]), first, second)
    together, _ = ddpg.update(start(), both, KEY, config=double, hyper=still, step=LATE)
    apart = run(run(start(), first, still)[0], second, still)[0]
    for name in ("critic", "target_critic"):
        assert_same_movement(*(getattr(s, name) for s in (start(), together, apart)), 1e-3)
