"""A robot that stands or stumbles with untrained policies still finds out what is broken, and obeys its choice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.atlas import recovery, tracking
from srl_jax.atlas.robots import CRobot, World
from srl_jax.env import damage, hexapod
from srl_jax.env.senses import felt, observation
from srl_jax.env.settings import EnvConfig

STRIKE, SECONDS = 10, 1.5


@pytest.fixture(scope="module")
def stories(atlas):
    """Robots of each damage; two of them may not know what theirs is."""
    bodies = [CRobot(name, STRIKE, seed=3) for name in (*atlas.damages, "leg_rm", "leg_rf+leg_lr")]
    known = [recovery.scope(atlas)] * 4
    known += [recovery.scope(atlas, ["leg_rm"]), recovery.scope(atlas, ["leg_lr+leg_rf"])]
    return bodies, recovery.run(atlas, bodies, seconds=SECONDS, scopes=lambda step: known, compose=False)


def test_each_names_its_damage_soon_after_it_strikes_and_not_before(atlas, stories):
    _, story = stories
    assert story.log_belief.shape == (30, 6, 8), "four damages, three that a robot may put together, none of these"
    np.testing.assert_allclose(np.exp(story.log_belief).sum(-1), 1.0, rtol=1e-4)
    assert np.all(np.argmax(story.log_belief[STRIKE], axis=-1) == 0), "all are healthy until then"
    assert np.argmax(story.log_belief[-1, :4], axis=-1).tolist() == [0, 1, 2, 3]
    assert story.policy[-1, :4].tolist() == [0, 1, 2, 3]


def test_what_is_left_out_is_neither_believed_nor_used(atlas, stories):
    _, story = stories
    assert np.all(story.log_belief[:, 4, 1] == -np.inf) and np.all(story.log_belief[:, 5, 3] == -np.inf)
    assert not np.any(story.policy[:, 4] == 1) and not np.any(story.policy[:, 5] == 3)
    assert np.exp(story.log_belief[-1, 4, 0]) < 0.5, "it is not healthy, whatever it is"


def test_who_is_told_obeys_at_once(atlas):
    bodies = [CRobot("healthy", 100, seed) for seed in range(6)]  # as many as before: the program is the same
    told = lambda step: [recovery.scope(atlas, told=2 if step >= 3 else seed % 4) for seed in range(6)]  # noqa: E731
    story = recovery.run(atlas, bodies, seconds=0.3, scopes=told)
    assert story.policy[:3].tolist() == [[0, 1, 2, 3, 0, 1]] * 3 and np.all(story.policy[3:] == 2)
    assert all(len(body.positions) == 6 for body in bodies)


def test_a_robots_senses_give_the_observation_of_training(atlas):
    body = CRobot("leg_rm", 0, world=World(noise=0.0))
    body.reset()
    senses = body.step(np.linspace(-0.3, 0.3, 18))
    for kind in ("onboard", "rates"):
        robot = hexapod.make("x", EnvConfig(observation=kind), 2.0)
        own, _ = hexapod.reset(robot, damage.build("leg_rm"), jnp.zeros(2, jnp.uint32))
        state = own._replace(
            qpos=jnp.float32(body._data.qpos), qvel=jnp.float32(body._data.qvel), phase=jnp.float32(0.3)
        )
        wanted = hexapod.observe(robot, damage.build("leg_rm"), state)
        np.testing.assert_allclose(observation(senses, jnp.float32(0.3), task="x", kind=kind), wanted, atol=2e-5)
    with pytest.raises(ValueError, match="observation is 'full'"):
        observation(senses, jnp.float32(0.3), task="x", kind="full")


def test_a_hypothesis_that_is_led_follows_a_robot_that_it_did_not_start_as():
    """Its angles, tilt and turning come to those that are felt, from a start that is off."""
    robot = hexapod.make("x", EnvConfig(observation="onboard"), 2.0)
    body = CRobot("healthy", 1_000, world=World(noise=0.0, friction=1.0))
    body.reset()
    stacked, start = damage.stack(["healthy"]), tracking.at_rest(robot, 1)
    follow = jax.jit(lambda *args: tracking.follow(robot, stacked, *args, tracking.GAINS))
    start = start._replace(qpos=start.qpos.at[:, 7:].add(0.2))
    sizes = []
    for step in range(20):
        action = 0.3 * np.sin(0.6 * step + np.arange(18))
        senses = body.step(action)
        start, errors = follow(start, jnp.float32(action), felt(senses), jnp.asarray(senses.answering))
        sizes.append(np.abs(np.asarray(errors[0, :18])).mean())
    assert sizes[0] > 0.03 and np.mean(sizes[-5:]) < 0.02
