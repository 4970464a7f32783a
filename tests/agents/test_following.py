"""Heads for policies: their targets and draws against NumPy, and a chain on which one action tells nothing."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, following, posterior, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.networks import Critic
from srl_jax.agents.selection import proposals
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import controller, dropout
from srl_jax.types import ActState, Transition
from tests.agents.reference import ACTION, BATCH, OBSERVATION, assert_same_movement, batch_of
from tests.agents.small_srl import FULL, KEY, OFF, STEP, high, run, start

POLICY = dataclasses.replace(FULL, values="policy")


def low(observation: jax.Array) -> jax.Array:
    return -high(observation)


TEACHERS = (high, low)


def begin(config: SRLConfig = POLICY, seed: int = 0) -> ddpg.AgentState:
    make = jax.jit(lambda key: srl.init(key, OBSERVATION, ACTION, config=config, teachers=TEACHERS))
    return make(jax.random.key(seed))._replace(target_critic=make(jax.random.key(seed + 5)).critic)


def head_of(critic, member: int, observation, action, masks=None) -> np.ndarray:
    """Every head f32[3] of one member at one action, by the network itself."""
    network = Critic(FULL.hidden, FULL.layer_norm, heads=3)
    return np.asarray(network.apply(jax.tree.map(lambda x: x[member], critic), observation, action, masks))


def loop_values(critic, observation, actions) -> np.ndarray:
    """f32[K, B, N]: of the action of policy i, head i."""
    return np.array(
        [
            [
                [head_of(critic, k, o, a)[i] for i, a in enumerate(own)]
                for o, own in zip(observation, actions, strict=True)
            ]
            for k in range(2)
        ]
    )


def next_actions(state: ddpg.AgentState, batch: Transition) -> jax.Array:
    of = lambda o: proposals(state.target_actor, o, TEACHERS, config=POLICY)  # noqa: E731
    return jax.vmap(of)(jnp.asarray(batch.next_observation))


@pytest.mark.parametrize("members", [False, True])
def test_every_head_bootstraps_from_its_own_policy(members):
    config, state, batch = dataclasses.replace(POLICY, member_targets=members), begin(), batch_of()
    target = srl.td_target(state, batch, TEACHERS, config=config, hyper=from_config(config))
    next_q = loop_values(state.target_critic, batch.next_observation, next_actions(state, batch))
    if not members:
        next_q = next_q.mean(0, keepdims=True).repeat(2, 0)
    expected = batch.reward[None, :, None] + 0.97 * batch.discount[None, :, None] * next_q
    np.testing.assert_allclose(target, expected, rtol=1e-5, atol=1e-6)
    assert np.ptp(np.asarray(target)[:, batch.discount > 0], axis=-1).min() > 1e-4, "the heads' targets differ"


def test_the_loss_is_that_of_all_heads_on_every_transition():
    state, batch = begin(), batch_of()
    _, metrics = run(state, batch, POLICY, teachers=TEACHERS)
    hyper = from_config(POLICY)
    target = np.asarray(srl.td_target(state, batch, TEACHERS, config=POLICY, hyper=hyper))
    rows = zip(batch.observation, batch.action, strict=True)
    q = np.array([[head_of(state.critic, k, o, a) for k in range(2)] for o, a in rows]).swapaxes(0, 1)
    assert metrics["critic_loss"] == pytest.approx(np.square(q - target).sum(2).mean(), rel=1e-4)


def test_draws_are_of_each_policys_own_head_under_one_mask_for_all():
    state, observation = begin(), jnp.asarray(batch_of().observation[0])
    actions = proposals(state.actor, observation, TEACHERS, config=POLICY)
    masks = posterior.sample(KEY, config=POLICY, hyper=from_config(POLICY))
    draws = posterior.draws(state.critic, observation, actions, masks, config=POLICY)
    assert draws.shape == (8, 3)
    for m in range(8):
        member, mask = m % 2, tuple(x[m % 2, m // 2] for x in masks)
        expected = [head_of(state.critic, member, observation, actions[i], mask)[i] for i in range(3)]
        np.testing.assert_allclose(draws[m], expected, rtol=1e-4, atol=1e-6)
    means = posterior.means(state.critic, observation, actions, config=POLICY)
    expected = loop_values(state.critic, observation[None], actions[None])[:, 0].mean(0)
    np.testing.assert_allclose(means, expected, rtol=1e-4, atol=1e-6)


def swayed(state: ddpg.AgentState, head: int, by: float) -> ddpg.AgentState:
    """The agent that holds one policy's value to be higher."""
    critic = jax.tree.map(jnp.copy, state.critic)
    critic["params"]["heads"]["bias"] = critic["params"]["heads"]["bias"].at[:, head].add(by)
    return state._replace(critic=critic)


@pytest.mark.parametrize("weighting", ["posterior", "mean"])
def test_whom_it_is_worth_following_pulls(weighting):
    config = dataclasses.replace(POLICY, guidance_weighting=weighting)
    batch, own = batch_of(), jnp.zeros((BATCH, ACTION))
    advice = jax.vmap(lambda o: jnp.stack([high(o), low(o)]))(jnp.asarray(batch.observation))
    pull = jax.jit(
        lambda critic: srl.guidance(
            critic, batch, own, advice, KEY, config=config, hyper=from_config(config), step=STEP
        )
    )
    for head, sure, who in ((0, 0.0, None), (1, 1.0, 0), (2, 1.0, 1)):
        p, guide = pull(swayed(begin(), head, 50.0).critic)
        np.testing.assert_array_equal(p, np.full(BATCH, sure))
        assert who is None or np.all(np.asarray(guide) == who)


def test_the_actor_climbs_the_students_head():
    still = dict(critic_lr=0.0, guidance_weight=0.0)
    state = begin()
    after = [
        run(s, batch_of(), POLICY, teachers=TEACHERS, **still)[0] for s in (state, shifted(state, 1), shifted(state, 0))
    ]
    assert_same_movement(state.actor, after[1].actor, after[0].actor, 1e-6)
    with pytest.raises(AssertionError):
        assert_same_movement(state.actor, after[2].actor, after[0].actor, 1e-2)


def shifted(state: ddpg.AgentState, head: int) -> ddpg.AgentState:
    """The agent with other weights of one head."""
    critic = jax.tree.map(jnp.copy, state.critic)
    kernel = critic["params"]["heads"]["kernel"]
    critic["params"]["heads"]["kernel"] = kernel.at[..., head].set(-3.0 * kernel[..., head])
    return state._replace(critic=critic)


def test_one_head_learns_what_the_critic_without_heads_does():
    alone, plain = dataclasses.replace(OFF, values="policy"), start()

    def renamed(critic):
        own = dict(critic["params"])
        return {"params": {"heads" if name == "Dense_0" else name: leaf for name, leaf in own.items()}}

    optimiser = plain.critic_optimiser._replace(
        mu=renamed(plain.critic_optimiser.mu), nu=renamed(plain.critic_optimiser.nu)
    )
    headed = plain._replace(
        critic=renamed(plain.critic), target_critic=renamed(plain.target_critic), critic_optimiser=optimiser
    )
    expected, metrics = run(plain, batch_of(), OFF)
    found, same = run(headed, batch_of(), alone)
    assert same["critic_loss"] == pytest.approx(float(metrics["critic_loss"]), rel=1e-5)
    assert_same_movement(renamed(plain.critic), found.critic, renamed(expected.critic), 1e-4)
    assert_same_movement(plain.actor, found.actor, expected.actor, 1e-4)


def test_without_heads_nothing_is_added():
    state = jax.eval_shape(lambda: srl.init(KEY, OBSERVATION, ACTION, config=FULL, teachers=TEACHERS))
    assert jax.tree.structure(state) == jax.tree.structure(start())
    assert following.heads(FULL, TEACHERS) == 0 and following.heads(POLICY, TEACHERS) == 3
    assert "heads" not in state.critic["params"]


def test_a_target_of_one_policy_does_not_go_with_the_best_of_all():
    with pytest.raises(ValueError, match=r"srl\.behaviour_target is True with srl\.values=policy, .*: leave one out"):
        SRLConfig(values="policy", behaviour_target=True).check("srl")


# A chain of four places. At the first a high action earns 1, at the others it costs 1; the student stays near 0.

LENGTH, GAMMA = 4, 0.9
CHAIN = SRLConfig(
    hidden=(16, 16),
    critics=2,
    critic_updates=1,
    critic_lr=(1e-2,),
    tau=(0.1,),
    gamma=(GAMMA,),
    freeze=(1e9,),
    dropout=(0.0,),
    noise=(0.0,),
    guidance_weight=(0.0,),
)


def eager(observation: jax.Array) -> jax.Array:
    """The teacher whose first action is good, and who goes on with it."""
    return 1.0 + 0.0 * observation[:1]


def chain_batch(key: jax.Array, size: int = 32) -> Transition:
    place_key, action_key = jax.random.split(key)
    place = jax.random.randint(place_key, (size,), 0, LENGTH)
    action = jax.random.uniform(action_key, (size, 1), minval=-1.0)
    zeros = jnp.zeros(size)
    return Transition(
        observation=jax.nn.one_hot(place, LENGTH),
        action=action,
        reward=jnp.where(place == 0, 1.0, -1.0) * action[:, 0],
        discount=(place < LENGTH - 1).astype(jnp.float32),
        next_observation=jax.nn.one_hot(place + 1, LENGTH),
        chosen=zeros,
        lot=zeros,
    )


def learned(config: SRLConfig) -> ddpg.AgentState:
    """Critics after 300 mini-batches of any actions; the student stays what it was."""
    hyper = from_config(config)

    def learn(state, key):
        settings = dict(config=config, hyper=hyper, step=jnp.float32(0.0), teachers=(eager,))
        return srl.update(state, chain_batch(key), key, **settings)[0], None

    state = srl.init(KEY, LENGTH, 1, config=config, teachers=(eager,))
    return jax.jit(lambda s: jax.lax.scan(learn, s, jax.random.split(KEY, 300))[0])(state)


def chosen(config: SRLConfig, state: ddpg.AgentState) -> list[int]:
    """Who is chosen at every place."""
    idle, settings = ActState(jnp.zeros(1), controller.init()), dict(hyper=from_config(config), teachers=(eager,))
    act = lambda o: srl.act(state, idle, o, KEY, config=config, step=STEP, **settings)[1].guidance.choice  # noqa: E731
    return jax.jit(jax.vmap(act))(jnp.eye(LENGTH)).tolist()


def test_following_differs_from_one_action():
    policy = dataclasses.replace(CHAIN, values="policy")
    state, one = learned(policy), learned(CHAIN)
    places = jnp.eye(LENGTH)
    actions = jax.vmap(lambda o: proposals(state.actor, o, (eager,), config=policy))(places)
    values = following.values(state.critic, places, actions, config=policy).mean(0)
    worth = np.zeros((LENGTH + 1, 2))
    for place in reversed(range(LENGTH)):
        reward = (1.0 if place == 0 else -1.0) * np.asarray(actions)[place, :, 0]
        worth[place] = reward + GAMMA * worth[place + 1]
    np.testing.assert_allclose(values, worth[:-1], atol=0.2)
    assert worth[0, 1] < -1.0, "its first action is worth 1, and following it costs"
    assert chosen(CHAIN, one) == [1, 0, 0, 0] and chosen(policy, state) == [0, 0, 0, 0]
    masks = dropout.sample_masks(KEY, CHAIN.hidden, (2, 1), jnp.float32(0.0))
    draws = posterior.draws(one.critic, places[0], actions[0], masks, config=CHAIN)
    np.testing.assert_allclose(draws[:, 1] - draws[:, 0], 1.0, atol=0.2)
