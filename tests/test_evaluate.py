"""Rollouts outside training: that MJX and C MuJoCo tell the same story, and what comes after the end."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax import evaluate
from srl_jax.env import damage, hexapod
from srl_jax.env.anatomy import JOINTS
from srl_jax.env.settings import EnvConfig

STEPS = 30
DAMAGES = ("healthy", "leg_rm")


def walk(stride: jax.Array, observation: jax.Array) -> jax.Array:
    """A tripod gait that steers by the goal's direction, so that small differences would feed back."""
    angle = jnp.arctan2(observation[0], observation[1]) + jnp.pi * jnp.array([0.0, 1, 0, 1, 0, 1])
    side = jnp.array([1.0, 1, 1, -1, -1, -1])
    coxa = -stride * side * jnp.cos(angle) * jnp.clip(observation[2] + side * observation[3], -1, 1)
    return jnp.stack([coxa, 0.7 * jnp.maximum(jnp.sin(angle), 0), jnp.zeros(6)], axis=1).reshape(-1)


@pytest.fixture(scope="module")
def robot() -> hexapod.Hexapod:
    # The goal is so near that some episodes reach it and others run out of time.
    config = EnvConfig(episode_steps=25, start_noise=0.2, goal_ring=(0.2, 0.5))
    return hexapod.make("p2p", config, 1.5)


@pytest.fixture(scope="module")
def keys() -> jax.Array:
    return jax.random.split(jax.random.key(0), 6)


@pytest.fixture(scope="module")
def policy():
    return jax.tree_util.Partial(walk, jnp.float32(0.8))


@pytest.fixture(scope="module")
def rollouts(robot, keys, policy) -> dict[str, evaluate.Rollout]:
    """The file's one compiled physics."""
    return {
        name: jax.device_get(evaluate.rollout_mjx(robot, damage.build(name), policy, keys, STEPS)) for name in DAMAGES
    }


@pytest.mark.parametrize("name", DAMAGES)
def test_mjx_and_c_tell_the_same_story(robot, rollouts, keys, policy, name):
    for i, key in enumerate(keys):
        ours = jax.tree.map(lambda leaf, i=i: leaf[i], rollouts[name])
        theirs = evaluate.rollout_c(robot, name, policy, key, STEPS)
        assert jax.tree.map(np.shape, ours) == jax.tree.map(np.shape, theirs)
        assert int(ours.length) == int(theirs.length)
        assert (bool(ours.success), bool(ours.fell)) == (bool(theirs.success), bool(theirs.fell))
        # Measured: 1e-6 m; the margin is for touch-downs moved by another processor's rounding.
        np.testing.assert_allclose(ours.qpos, theirs.qpos, rtol=0, atol=5e-3)
        np.testing.assert_allclose(ours.qpos[:, :3], theirs.qpos[:, :3], rtol=0, atol=5e-4)
        np.testing.assert_allclose(ours.distance, theirs.distance, rtol=0, atol=5e-4)
        np.testing.assert_allclose(ours.reward, theirs.reward, rtol=0, atol=3e-2)
        np.testing.assert_array_equal(ours.goal, theirs.goal)


def test_nothing_happens_after_the_end(rollouts):
    lengths = rollouts["healthy"].length
    assert lengths.min() < 25
    assert lengths.max() == 25  # out of time
    for rollout in rollouts.values():
        for qpos, reward, length in zip(rollout.qpos, rollout.reward, rollout.length, strict=True):
            np.testing.assert_array_equal(qpos[length:], np.tile(qpos[length - 1], (STEPS - length, 1)))
            assert not reward[length:].any()
            assert reward[:length].all()


def test_what_is_reported_follows_from_the_path(rollouts):
    for rollout in rollouts.values():
        left = np.linalg.norm(rollout.goal - rollout.qpos[:, -1, :2], axis=1)
        np.testing.assert_array_equal(rollout.success, left < 0.15)
        assert rollout.success[rollout.length < 25].all()
        np.testing.assert_allclose(rollout.distance, np.linalg.norm(rollout.goal, axis=1) - left, atol=1e-5)
        assert not rollout.fell.any()


def test_the_program_is_shared_by_parameters_damages_and_robots(robot, rollouts, keys):
    del rollouts
    compiled = evaluate._roll._cache_size()
    again = hexapod.make(robot.task, robot.config, robot.clock_hz)
    still = jax.tree_util.Partial(walk, jnp.float32(0.0))
    rollout = evaluate.rollout_mjx(again, damage.build("tibia_lf:limp"), still, keys, STEPS)
    assert evaluate._roll._cache_size() == compiled
    assert np.abs(rollout.distance).max() < 0.1  # marches on the spot


def test_a_lost_limb_is_not_felt_in_c(robot, keys):
    """A policy that follows the middle right coxa stands still where that is lost, and moves where it is not."""
    follow = lambda observation: jnp.clip(5.0 * observation[8 + JOINTS.index("coxa_rm")], -1.0, 1.0) * jnp.ones(18)  # noqa: E731
    stand = lambda observation: jnp.zeros(18)  # noqa: E731
    path = lambda name, policy: evaluate.rollout_c(robot, name, policy, keys[0], 5).qpos  # noqa: E731
    np.testing.assert_array_equal(path("leg_rm", follow), path("leg_rm", stand))
    assert np.abs(path("leg_rm:limp", follow) - path("leg_rm:limp", stand)).max() > 0.1


def test_a_plain_function_is_a_policy(robot, keys):
    rollout = evaluate.rollout_c(robot, "healthy", lambda observation: jnp.zeros(18), keys[0], 3)
    assert rollout.qpos.shape == (3, 25)
    assert int(rollout.length) == 3


def test_converged_physics_is_another_but_similar_walk(robot, keys, policy):
    coarse = evaluate.rollout_c(robot, "healthy", policy, keys[0], 20)
    fine = evaluate.rollout_c(robot, "healthy", policy, keys[0], 20, model=evaluate.converged_model("healthy"))
    assert np.abs(coarse.qpos[:, :2] - fine.qpos[:, :2]).max() < 0.1
    assert coarse.distance != fine.distance


def test_a_fall_ends_the_episode_in_c(robot, keys, policy):
    model = damage.damaged_model("healthy")
    model.opt.gravity[:] = [0.0, 30.0, 0.0]
    model.body_gravcomp[2:] = 1.0  # pulls at the torso only, which turns about the standing feet
    model.body_ipos[1] = [0.0, 0.0, 0.2]
    rollout = evaluate.rollout_c(robot, "healthy", policy, keys[0], STEPS, model=model)
    assert bool(rollout.fell)
    assert int(rollout.length) < 25


def test_mistakes_are_refused_in_a_sentence(robot, keys, policy):
    with pytest.raises(ValueError, match="steps is 0; at least 1"):
        evaluate.rollout_mjx(robot, damage.build("healthy"), policy, keys, 0)
    with pytest.raises(ValueError, match="steps is -1; at least 1"):
        evaluate.rollout_c(robot, "healthy", policy, keys[0], -1)
    with pytest.raises(ValueError, match="unknown part"):
        evaluate.rollout_c(robot, "knee_rm", policy, keys[0], 1)
    model = damage.damaged_model("healthy")
    model.opt.timestep = 0.003
    with pytest.raises(ValueError, match="whole fractions of the control period"):
        evaluate.rollout_c(robot, "healthy", policy, keys[0], 1, model=model)
