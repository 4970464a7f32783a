"""Jump-start RL: who acts when, and that it learns as DDPG does."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import ddpg, jump_start, registry
from srl_jax.agents.hyper import from_config
from srl_jax.agents.rivals import JumpStartConfig
from srl_jax.bayes import controller
from srl_jax.types import ActState
from tests.agents.reference import ACTION, OBSERVATION, batch_of
from tests.agents.small_srl import SHARED, STATIC, STEP, high, start, student

CONFIG = JumpStartConfig(**SHARED, noise=(0.1,), jump_steps=(40.0,), jump_decay=(1_000.0,))
KEY, SEEN = jax.random.key(0), jnp.ones(OBSERVATION)
act = jax.jit(jump_start.act, static_argnames=STATIC)


def idle(age: int | None) -> ActState:
    age_ = None if age is None else jnp.int32(age)
    return ActState(jnp.zeros(ACTION), controller.init(), age=age_)


def decide(age, step, teachers=(high, lambda observation: -high(observation))):
    keywords = dict(config=CONFIG, hyper=from_config(CONFIG), teachers=teachers)
    return act(start(), idle(age), SEEN, KEY, step=jnp.float32(step), **keywords)


@pytest.mark.parametrize(("step", "last"), [(0, 39), (500, 19), (990, 0)])
def test_the_teacher_acts_in_the_first_steps_of_an_episode_and_they_become_fewer(step, last):
    for age, who in ((0, 1), (last, 1), (last + 1, 0), (99, 0)):
        action, after = decide(age, step)
        assert after.guidance.choice == who, age
        mean = high(SEEN) if who else student(start().actor, SEEN)
        np.testing.assert_allclose(action, jnp.clip(mean + 0.1 * after.noise, -1, 1), atol=1e-6)


@pytest.mark.parametrize("step", [1_000, 5_000])
def test_in_the_end_the_student_acts_alone(step):
    assert decide(0, step)[1].guidance.choice == 0


def test_it_needs_a_clock_and_a_teacher():
    with pytest.raises(ValueError, match="age is None and there are 2 teachers: both are needed"):
        decide(None, 0)
    with pytest.raises(ValueError, match="there are 0 teachers"):
        decide(0, 0, teachers=())


def test_it_learns_as_ddpg_does():
    agent, hyper = registry.agent(CONFIG), from_config(CONFIG)
    mine, _ = jax.jit(lambda s: agent.update(s, batch_of(), KEY, hyper=hyper, step=STEP, teachers=(high,)))(start())
    settings = dict(config=CONFIG, hyper=hyper, step=STEP)
    reference, _ = jax.jit(lambda s: ddpg.update(s, batch_of(), KEY, **settings))(start())
    for name in ("actor", "critic", "target_critic"):
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), *(getattr(s, name) for s in (mine, reference))
        )
    assert agent.timed and agent.adopt is None
