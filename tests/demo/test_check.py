"""The check of what a page will show: the page's robot in NumPy sees what the package's robot sees."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import file
from srl_jax.atlas.stored import policies as policies_of
from srl_jax.demo import check
from srl_jax.env import damage, hexapod
from srl_jax.env.settings import EnvConfig

CLOCK_HZ = 1.9442


def wiggle(observation):
    return 0.5 * np.sin(np.arange(18) + 3.0 * observation[0])


@pytest.mark.parametrize(
    ("task", "kind"), [("x", "onboard"), ("xy", "rates"), ("p2p", "full"), ("p2p", "onboard"), ("x", "full")]
)
def test_it_sees_what_the_package_sees(task, kind):
    walker = check.Walker("leg_rm", task, kind, CLOCK_HZ)
    walker.broken = 1
    for _ in range(7):
        walker.step(wiggle)
    data, robot = walker.data, hexapod.make(task, EnvConfig(observation=kind), CLOCK_HZ)
    state, _ = hexapod.reset(robot, damage.build("healthy"), jax.random.key(0))
    state = state._replace(
        qpos=jnp.asarray(data.qpos, jnp.float32),
        qvel=jnp.asarray(data.qvel, jnp.float32),
        phase=jnp.float32(7 * CLOCK_HZ / 20.0 % 1.0),
        goal=jnp.asarray(walker.goal, jnp.float32),
    )
    expected = hexapod.observe(robot, damage.build("leg_rm"), state)
    np.testing.assert_allclose(walker.observe(), np.asarray(expected), atol=1e-4)


def test_a_policy_of_the_atlas_walks_on_and_one_that_stands_does_not():
    atlas = file.load()
    policies = policies_of(atlas)
    clock = atlas.about["clock_hz"]
    walked = check.after_cut(
        check.Walker("leg_lf", "x", "onboard", clock), policies["healthy"], policies["leg_lf"], stands=False
    )
    assert walked.speed > 0.4 and not walked.fell
    still = check.after_cut(
        check.Walker("leg_lf", "x", "onboard", clock), policies["healthy"], lambda seen: np.zeros(18), stands=True
    )
    assert abs(still.speed) < 0.05 and not still.fell


def test_a_goal_that_is_reached_is_followed_by_another():
    walker = check.Walker("healthy", "p2p", "onboard", CLOCK_HZ)
    walker.goal = np.array([0.1, 0.0])
    walker.step(None)
    assert np.linalg.norm(walker.goal - walker.path[-1]) == pytest.approx(check.GOAL)


def test_one_that_has_tipped_over_has_fallen():
    walker = check.Walker("healthy", "x", "onboard", CLOCK_HZ)
    walker.data.qpos[3:7] = [0.0, 1.0, 0.0, 0.0]
    walker.step(None)
    assert walker.fell
