"""The agents learn a task whose answer is known, and the task is the one that Gymnasium defines."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from experiments import pendulum


def test_step_follows_the_published_equations():
    rng, step = np.random.default_rng(0), jax.jit(pendulum.step)
    for _ in range(50):
        angle, speed, action = rng.uniform(-9, 9), rng.uniform(-8, 8), rng.uniform(-1, 1)
        torque, near = 2 * action, ((angle + np.pi) % (2 * np.pi)) - np.pi
        cost = near**2 + 0.1 * speed**2 + 0.001 * torque**2
        faster = np.clip(speed + (3 * 10 / 2 * np.sin(angle) + 3 * torque) * 0.05, -8, 8)
        after, reward = step(jnp.float32([angle, speed]), jnp.float32([action]))
        np.testing.assert_allclose(reward, -cost, rtol=1e-4)
        np.testing.assert_allclose(after, [near + faster * 0.05, faster], atol=1e-4)


def test_the_teacher_swings_up_and_doing_nothing_does_not():
    keys = jax.random.split(jax.random.key(0), 100)
    earn = lambda policy: jax.jit(jax.vmap(partial(pendulum.episode_return, policy)))(keys)  # noqa: E731
    assert earn(pendulum.swing_up).mean() > -200
    assert earn(lambda observation: jnp.zeros(1)).mean() < -1000


def test_ddpg_learns_to_swing_up():
    config = dataclasses.replace(pendulum.CONFIGS["ddpg"], hidden=(64, 64), batch=64)
    run = jax.jit(jax.vmap(partial(pendulum.train, config=config, steps=8_000)))
    returns = run(jnp.arange(3))
    assert returns.mean() > -300, returns  # doing nothing earns about -1200, a trained policy about -160


def test_srl_learns_to_swing_up():
    """Judged by the student alone, which its teacher has guided at replayed states and relieved at others."""
    config = dataclasses.replace(pendulum.CONFIGS["srl"], hidden=(32, 32), batch=64)
    run = jax.jit(jax.vmap(partial(pendulum.train, config=config, steps=3_000)))
    returns = run(jnp.arange(3))
    assert returns.mean() > -400, returns
