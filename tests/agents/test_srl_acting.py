"""SRL's decisions: who acts under a critic whose opinion is known."""

import dataclasses

import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, srl
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.bayes import controller
from srl_jax.types import ActState
from tests.agents.reference import ACTION, OBSERVATION, convinced_critic
from tests.agents.small_srl import KEY, STATIC, STEP, high

SHARED = dict(critic_updates=1, tau=(0.01,), hidden=(8, 8), layer_norm=False, critics=2, init="random", noise=(0.1,))
FULL = SRLConfig(**SHARED, dropout=(0.3,), draws=8)
OFF, BASELINE = SRLConfig(**SHARED, select=False), DDPGConfig(**SHARED)
act = jax.jit(srl.act, static_argnames=STATIC)
init = jax.jit(lambda key: srl.init(key, OBSERVATION, ACTION, config=FULL))
student = jax.jit(lambda actor, observation: ddpg.student(actor, observation, config=FULL))


def change(config: SRLConfig = FULL, **fields) -> SRLConfig:
    return dataclasses.replace(config, **fields)


def start() -> ddpg.AgentState:
    return init(KEY)


def convinced(slope: float) -> ddpg.AgentState:
    """An agent whose members all believe ``Q(s, a) = slope (4 + sum(a))``."""
    state = start()
    critic = convinced_critic(state.critic, slope, OBSERVATION)
    return state._replace(critic=critic)


def idle(choice: int = 0) -> ActState:
    guidance = controller.init()._replace(choice=jnp.int32(choice))
    return ActState(jnp.zeros(ACTION), guidance)


def decide(state, config, key=KEY, teachers=(high,), before=None, observation=None, **overrides):
    observation = jnp.ones(OBSERVATION) if observation is None else observation
    keywords = dict(config=config, hyper=from_config(config, **overrides), step=STEP, teachers=teachers)
    return act(state, before or idle(), observation, key, **keywords)


def own_action(state, observation=None):
    return ddpg.student(state.actor, jnp.ones(OBSERVATION) if observation is None else observation, config=FULL)


def test_acting_without_selection_is_ddpg():
    noise_key = jax.random.split(KEY, 3)[2]
    mine, after = decide(start(), OFF)
    expected, reference = ddpg.act(
        start(),
        idle(),
        jnp.ones(OBSERVATION),
        noise_key,
        config=BASELINE,
        hyper=from_config(BASELINE),
        step=STEP,
    )
    np.testing.assert_allclose(mine, expected, atol=1e-6)
    chex.assert_trees_all_close(after, reference)


@pytest.mark.parametrize("commit", [True, False])
@pytest.mark.parametrize(("slope", "before", "chosen"), [(1.0, 0, 1), (1.0, 1, 1), (-1.0, 0, 0), (-1.0, 1, 0)])
def test_who_acts_is_whom_the_critic_prefers(commit, slope, before, chosen):
    state = convinced(slope)
    action, after = decide(state, change(commit=commit), before=idle(before), dropout=0.0)
    assert after.guidance.choice == chosen
    mean = high(jnp.ones(OBSERVATION)) if chosen else own_action(state)
    np.testing.assert_allclose(action, jnp.clip(mean + 0.1 * after.noise, -1, 1), atol=1e-6)


def test_the_best_of_several_teachers_acts():
    low = lambda o: -high(o)  # noqa: E731
    assert decide(convinced(1.0), FULL, teachers=(low, high), dropout=0.0)[1].guidance.choice == 2
    assert decide(convinced(-1.0), FULL, teachers=(low, high), dropout=0.0)[1].guidance.choice == 1


def test_a_refused_switch_counts_and_keeps_the_policy():
    never = dict(beta=1.0, psi=1.0, dropout=0.0)
    _, after = decide(convinced(1.0), FULL, **never)
    assert (after.guidance.choice, after.guidance.refused) == (0, 1)
    _, after = decide(convinced(-1.0), FULL, before=idle(1), **never)
    assert (after.guidance.choice, after.guidance.refused) == (1, 1)


@pytest.mark.parametrize(("slope", "before", "chosen"), [(1.0, 0, 1), (-1.0, 1, 0)])
def test_the_greedy_choice_is_the_mean_critics_whatever_was_committed_to(slope, before, chosen):
    never = dict(beta=1.0, psi=1.0, dropout=0.9)
    for key in jax.random.split(KEY, 3):
        _, after = decide(convinced(slope), change(selection="greedy"), key, before=idle(before), **never)
        assert (after.guidance.choice, after.guidance.refused) == (chosen, 0)


def test_a_choice_is_kept_for_a_segment():
    config = change(segment=20)
    for age, kept in ((0, False), (1, True), (19, True), (20, False), (40, False), (59, True)):
        before = idle(0)._replace(age=jnp.int32(age))
        action, after = decide(convinced(1.0), config, before=before, dropout=0.0)
        assert after.guidance.choice == (0 if kept else 1), age
        mean = own_action(convinced(1.0)) if kept else high(jnp.ones(OBSERVATION))
        np.testing.assert_allclose(action, jnp.clip(mean + 0.1 * after.noise, -1, 1), atol=1e-6)
    with pytest.raises(ValueError, match=r"segment is 20: it needs act_state\.age"):
        decide(convinced(1.0), config)


def test_noisy_proposals_make_the_student_pay_for_its_noise():
    config = change(noisy_proposals=True)
    action, after = decide(convinced(1.0), config, dropout=0.0)
    assert after.guidance.choice == 1
    np.testing.assert_array_equal(action, high(jnp.ones(OBSERVATION)))
    action, after = decide(convinced(-1.0), config, dropout=0.0)
    np.testing.assert_allclose(action, own_action(convinced(-1.0)) + 0.1 * after.noise, atol=1e-6)
    # With noise enough, the student's own draw decides who acts; noise-free, it never does.
    loud = [decide(convinced(1.0), config, key, dropout=0.0, noise=5.0)[1] for key in jax.random.split(KEY, 24)]
    assert {int(after.guidance.choice) for after in loud} == {0, 1}


def test_one_posterior_sample_judges_all_proposals():
    state = start()
    teachers = (lambda o: ddpg.student(state.actor, o, config=FULL),)

    def choices(**fields):
        config = change(commit=False, **fields)
        decisions = [decide(state, config, key, teachers)[1] for key in jax.random.split(KEY, 40)]
        return np.array([after.guidance.choice for after in decisions])

    assert not choices().any(), "equal proposals tie under a shared sample, and the student goes first"
    assert 0.2 < choices(shared_masks=False).mean() < 0.8


def test_without_teachers_the_student_acts():
    _, after = decide(convinced(1.0), FULL, teachers=())
    assert (after.guidance.choice, after.guidance.refused) == (0, 0)


def test_acting_lanes_do_not_see_each_other():
    keys, observations = jax.random.split(KEY, 3), jax.random.normal(KEY, (3, OBSERVATION))
    state = start()
    one = jax.jit(jax.vmap(lambda o, k: decide(state, FULL, k, observation=o)))
    wide = one(observations, keys)
    other = one(observations.at[1:].add(5.0), keys)
    chex.assert_trees_all_equal(*(jax.tree.map(lambda x: x[0], x) for x in (wide, other)))
