"""Exploration noise: its schedule, its variance and correlation, and how an episode starts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.agents import noise
from srl_jax.agents.hyper import from_config
from srl_jax.agents.settings import DDPGConfig
from srl_jax.bayes import controller
from srl_jax.types import ActState

ACTION, CONFIG, KEY = 2, DDPGConfig(), jax.random.key(0)
LATE = jnp.float32(1e6)


def explored(action, key, start=None, step=0.0, **values):
    """What is executed in place of an action, from noise f32[A] carried (none: that of an episode's start)."""
    carried = noise.start(key, ACTION) if start is None else start
    state = ActState(carried, controller.init())
    return noise.explore(action, state, key, hyper=from_config(CONFIG, **values), step=jnp.float32(step))


def test_the_scale_follows_the_variance_schedule_to_its_floor():
    hyper = from_config(CONFIG, noise=0.5, noise_decay=0.9999, noise_floor=0.1)
    steps = np.array([0, 1, 1_000, 10_000, 32_000, 32_400, 1e6])
    scale = [float(noise.scale(hyper, jnp.float32(step))) for step in steps]
    np.testing.assert_allclose(scale, np.maximum(np.sqrt(0.25 * 0.9999**steps), 0.1), rtol=1e-3)
    assert noise.scale(from_config(CONFIG), LATE) == pytest.approx(0.25)


def test_no_noise_is_none_and_a_floor_above_the_start_does_not_raise_it():
    assert noise.scale(from_config(CONFIG, noise=0.0), jnp.float32(0.0)) == 0.0
    small = from_config(CONFIG, noise=0.02, noise_floor=0.05)
    assert noise.scale(small, jnp.float32(0.0)) == noise.scale(small, LATE) == pytest.approx(0.02)
    np.testing.assert_array_equal(explored(jnp.array([0.3, -0.2]), KEY, noise=0.0)[0], jnp.array([0.3, -0.2]))


@pytest.mark.parametrize("rho", [0.0, 0.85])
def test_it_has_its_variance_and_correlation(rho):
    hyper, rows = from_config(CONFIG, noise=0.1, noise_correlation=rho), 20_000

    @jax.jit
    def walk(key):
        def one(state, key):
            action, state = noise.explore(jnp.zeros(ACTION), state, key, hyper=hyper, step=jnp.float32(0.0))
            return state, action

        return jax.lax.scan(one, ActState(jnp.zeros(ACTION), controller.init()), jax.random.split(key, rows))[1]

    found = np.asarray(walk(KEY))[100:]
    error = np.sqrt((1 + rho) / (1 - rho) / rows)  # of a mean of correlated values
    np.testing.assert_allclose(found.mean(0), 0.0, atol=0.4 * error)
    np.testing.assert_allclose(found.std(0), 0.1, rtol=4 * error)
    correlation = [np.corrcoef(found[1:, i], found[:-1, i])[0, 1] for i in range(ACTION)]
    np.testing.assert_allclose(correlation, rho, atol=4 * error)
    assert abs(np.corrcoef(found.T)[0, 1]) < 4 * error


def test_an_episodes_first_steps_explore_as_its_later_ones_do():
    keys = jax.random.split(KEY, 4_000)
    start = lambda key: noise.start(jax.random.fold_in(key, 1), ACTION)  # noqa: E731
    first = jax.vmap(lambda key: explored(jnp.zeros(ACTION), key, start(key), noise=0.1)[0])(keys)
    assert first.shape == (4_000, ACTION)
    np.testing.assert_allclose(first.std(0), 0.1, rtol=4 / np.sqrt(2 * 4_000))


def test_actions_stay_in_range():
    loud, _ = explored(jnp.zeros(ACTION), KEY, noise=1e3)
    assert np.all(np.abs(loud) == 1.0)
