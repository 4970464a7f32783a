"""Probing motions and what is felt of them, with toy dynamics in place of physics."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.settings import EnvConfig
from srl_jax.ite import probing

KEY = jax.random.key(0)
STEPS = 30


@pytest.fixture(scope="module")
def robot():
    return hexapod.make("x", EnvConfig(start_noise=0.1), 1.0)


@pytest.fixture
def servos(monkeypatch):
    """A robot that hangs: joints are where they are told to be at once."""

    def simulate(robot, damage, state, control):
        return state._replace(qpos=state.qpos.at[7:].set(0.5 * state.qpos[7:] + 0.5 * control))

    monkeypatch.setattr(hexapod, "simulate", simulate)


def test_motions_are_small_smooth_and_all_different():
    actions = np.asarray(probing.probes(KEY, 12, 2 * STEPS, amplitude=0.4))
    assert actions.shape == (12, 2 * STEPS, 18) and actions.dtype == np.float32
    assert 0.2 < np.abs(actions).max() <= 0.4
    fastest = 0.4 * (2 * np.pi * probing.FREQUENCIES[1] + 1 / probing.RAMP) / hexapod.CONTROL_HZ
    assert np.abs(np.diff(actions, axis=1, prepend=0.0)).max() <= fastest
    assert np.abs(actions[:, 0]).max() <= 0.4 / (probing.RAMP * hexapod.CONTROL_HZ)
    flat = actions.reshape(12, -1)
    assert np.corrcoef(flat)[~np.eye(12, dtype=bool)].max() < 0.9
    legs = np.abs(actions).max(1).reshape(12, 6, 3).max(2)
    assert (legs.max(1) > 3 * legs.min(1)).all(), "in each, some legs move more than others"


def test_motions_depend_on_the_key_and_not_on_their_length():
    long, short = probing.probes(KEY, 3, STEPS), probing.probes(KEY, 3, 10)
    np.testing.assert_allclose(long[:, :10], short, atol=1e-6)
    assert not np.allclose(short, probing.probes(jax.random.key(1), 3, 10))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"count": 0, "steps": 5}, "count is 0"),
        ({"count": 3, "steps": 0}, "steps is 0"),
        ({"count": 3, "steps": 5, "amplitude": 1.5}, "amplitude is 1.5"),
    ],
)
def test_bad_motions_are_named(given, message):
    with pytest.raises(ValueError, match=message):
        probing.probes(KEY, **given)


def test_a_trace_feels_every_step_of_the_motion(robot, servos):
    action = probing.probes(KEY, 1, STEPS)[0]
    found = probing.trace(robot, damages.build("healthy"), action, jnp.zeros(()), KEY)
    joints, scale = np.zeros(18), np.tile(hexapod.ACTION_SCALE, 6)
    for t in range(STEPS):
        joints = 0.5 * joints + 0.5 * scale * np.asarray(action[t])
        np.testing.assert_allclose(found[t, :18], joints, atol=1e-5)


def test_spread_scales_the_noise_of_the_start(robot, servos):
    still = jnp.zeros((1, 18))
    run = lambda spread, key: probing.trace(robot, damages.build("healthy"), still, jnp.float32(spread), key)  # noqa: E731
    np.testing.assert_allclose(run(0.0, KEY)[0, :18], 0.0, atol=1e-6)
    whole = hexapod.reset(robot, damages.build("healthy"), KEY)[0].qpos[7:] - robot.stance[7:]
    np.testing.assert_allclose(run(1.0, KEY)[0, :18], 0.5 * whole, atol=1e-6)
    np.testing.assert_allclose(run(0.3, KEY)[0, :18], 0.15 * whole, atol=1e-6)
