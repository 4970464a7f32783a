"""Robots that walked when their damage struck: they move, they differ, and only where a run asks for them."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.config import Config
from srl_jax.env import damage, hexapod
from srl_jax.env.settings import EnvConfig
from srl_jax.job import plan
from srl_jax.program import strides

NAMES = ["healthy", "leg_rm+leg_lf"]


@pytest.fixture(scope="module")
def robot():
    return hexapod.make("p2p", EnvConfig(stride_starts=0.5), 2.0)


@pytest.fixture(scope="module")
def starts(robot):
    keys = jax.vmap(jax.random.key)(jnp.arange(2))
    return strides.make(robot, damage.stack(NAMES), keys)


def test_they_walk_upright_at_the_origin_at_any_phase(starts):
    starts = jax.device_get(starts)
    assert starts.qpos.shape == (2, strides.COUNT, 25)
    assert np.all(np.isfinite(starts.qpos)) and np.all(np.isfinite(starts.qvel))
    assert np.all(starts.qpos[..., :2] == 0.0)
    assert np.median(np.linalg.norm(starts.qvel[0, :, :2], axis=1)) > 0.3, "the healthy ones walk, each to its goal"
    assert np.ptp(starts.phase[0]) > 0.5
    assert np.std(starts.qpos[1, :, 2]) > np.std(starts.qpos[0, :, 2]), "damage makes them stumble"


def test_what_is_turned_moves_the_same_in_another_direction(robot, starts):
    """By a right angle, about which pyramids of friction are symmetric: turned and stepped is stepped and turned."""
    own = jax.tree.map(lambda leaf: leaf[1, 0], starts)
    values = jax.tree.map(jnp.asarray, damage.build(NAMES[1]))
    move = jax.jit(lambda state: hexapod.simulate(robot, values, state, hexapod.targets(robot, jnp.full(18, 0.3))))
    turned, straight = move(strides.turned(own, 0.5 * np.pi)), move(own)
    origin = straight._replace(qpos=straight.qpos.at[:2].set(0.0))
    expected = strides.turned(origin, 0.5 * np.pi)
    np.testing.assert_allclose(turned.qpos[2:], expected.qpos[2:], atol=2e-4)
    np.testing.assert_allclose(turned.qvel, expected.qvel, atol=2e-2)
    cosine, sine = 0.0, 1.0
    moved = np.array([[cosine, -sine], [sine, cosine]]) @ np.asarray(straight.qpos[:2])
    np.testing.assert_allclose(turned.qpos[:2], moved, atol=2e-4)


def test_an_episode_starts_from_one_of_them_as_often_as_asked(robot, starts):
    own = jax.tree.map(lambda leaf: leaf[0], starts)
    fresh, _ = hexapod.reset(robot, damage.build("healthy"), jax.random.key(9))

    def begun(share):
        body = robot._replace(config=dataclasses.replace(robot.config, stride_starts=share))
        keys = jax.random.split(jax.random.key(1), 400)
        return jax.vmap(lambda key: strides.begin(body, own, fresh, key))(keys)

    none, half, all_ = (np.any(np.asarray(begun(share).qvel) != 0.0, axis=1).mean() for share in (0.0, 0.5, 1.0))
    assert none == 0.0 and all_ == 1.0 and abs(half - 0.5) < 0.1
    assert np.all(np.asarray(begun(1.0).goal) == np.asarray(fresh.goal)), "the goal is the new episode's"


def test_a_share_is_a_share():
    with pytest.raises(ValueError, match=r"env.stride_starts is 1.5: it must lie between 0 and 1"):
        plan.make(Config(env=EnvConfig(stride_starts=1.5)))
