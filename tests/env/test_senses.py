"""What a robot feels, and that its observation is made of nothing else unless it asks for more."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage as damages
from srl_jax.env import hexapod, senses
from srl_jax.env.anatomy import JOINTS
from srl_jax.env.settings import EnvConfig

KEY = jax.random.key(0)


@pytest.fixture(scope="module")
def robot():
    return hexapod.make("x", EnvConfig(observation="onboard"), 2.0)


def test_senses_are_joints_gyroscope_and_gravity(robot):
    state, _ = hexapod.reset(robot, damages.build("healthy"), KEY)
    roll = 0.3  # rad, about the body's x: gravity turns towards its right, -y
    state = state._replace(
        qpos=state.qpos.at[3:7].set(jnp.array([np.cos(roll / 2), np.sin(roll / 2), 0.0, 0.0])),
        qvel=jnp.arange(24.0),
    )
    felt = senses.felt(hexapod.feel(robot, damages.build("healthy"), state))
    assert felt.shape == (senses.SIZE,) == senses.FELT_NOISE.shape
    np.testing.assert_allclose(felt[:18], state.qpos[7:] - robot.stance[7:], atol=1e-6)
    np.testing.assert_array_equal(felt[18:21], [3.0, 4.0, 5.0])
    np.testing.assert_allclose(felt[21:], [0.0, -np.sin(roll), -np.cos(roll)], atol=1e-6)
    np.testing.assert_array_equal(felt[senses.IMU], felt[18:])


@pytest.mark.parametrize(
    ("name", "silent"),
    [
        ("healthy", ()),
        ("tibia_rm", ("tibia_rm",)),
        ("femur_lf", ("femur_lf", "tibia_lf")),
        ("leg_lr", ("coxa_lr", "femur_lr", "tibia_lr")),
        ("leg_lr:limp", ()),
        ("coxa_rf:locked", ()),
    ],
)
def test_only_encoders_of_removed_links_are_silent(robot, name, silent):
    state, _ = hexapod.reset(robot, damages.build("healthy"), KEY)
    felt = senses.felt(hexapod.feel(robot, damages.build(name), state))
    expected = [joint for joint, angle in zip(JOINTS, felt[:18], strict=True) if angle == 0.0]
    assert tuple(expected) == silent


def test_how_far_it_came_is_the_tasks_business(robot):
    state, _ = hexapod.reset(robot, damages.build("healthy"), KEY)
    state = state._replace(qpos=state.qpos.at[:2].set(jnp.array([0.3, 0.4])), goal=jnp.array([0.3, 2.4]))
    come = {t: hexapod.feel(robot._replace(task=t), damages.build("healthy"), state).come for t in ("x", "xy", "p2p")}
    np.testing.assert_allclose([come["x"], come["xy"], come["p2p"]], [0.3, 0.5, -2.0], rtol=1e-5)


def test_no_robot_senses_a_full_observation(robot):
    state, _ = hexapod.reset(robot, damages.build("healthy"), KEY)
    feels = hexapod.feel(robot, damages.build("healthy"), state)
    with pytest.raises(ValueError, match="observation is 'full'"):
        senses.observation(feels, state.phase, task="x", kind="full")
