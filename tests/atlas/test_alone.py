"""A policy alone on a robot sees what it saw in training, its history included."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.tree_util import Partial

from srl_jax.atlas import alone
from srl_jax.atlas.robots import CRobot
from srl_jax.env import damage, hexapod
from srl_jax.env.settings import EnvConfig

SECONDS = 0.4
K = 2


def linear(weights, observation):
    """An action that every number of the observation moves."""
    return jnp.tanh(weights @ observation)


def onward(added, observation):
    """A little more than the action that the history has last."""
    return observation[-18:] + added


@pytest.fixture(scope="module")
def robot():
    return hexapod.make("x", EnvConfig(observation="rates", history=K), 2.0)


@pytest.fixture(scope="module")
def step(robot):
    return jax.jit(lambda *args: hexapod.step(robot, *args))


class Simulated:
    """The training's own robot, as one that only feels."""

    def __init__(self, robot, step, name, state):
        self.robot, self.damage, self.state = robot, damage.build(name), state
        self.advance = step

    def reset(self):
        return hexapod.feel(self.robot, self.damage, self.state)

    def step(self, action):
        self.state, _ = self.advance(self.damage, self.state, jnp.asarray(action))
        return self.reset()


def test_it_does_what_it_does_in_training(robot, step):
    names, walker = ("leg_rm", "femur_lf:limp"), alone.walker(robot)
    size = hexapod.observation_size("x", robot.config)
    weights = 0.1 * jax.random.normal(jax.random.key(1), (len(names), 18, size))
    keys, wanted, bodies = jax.random.split(jax.random.key(0), len(names)), [], []
    for name, key, own in zip(names, keys, weights, strict=True):
        values = damage.build(name)
        state, _ = hexapod.reset(robot, values, key)
        state = state._replace(phase=walker.begin(key).phase)  # as `walk` begins
        bodies.append(Simulated(robot, step, name, state))
        seen, actions = hexapod.observe(robot, values, state), []
        for _ in range(round(SECONDS * 20)):
            actions.append(linear(own, seen))
            state, out = step(values, state, actions[-1])
            seen = out.observation
        wanted.append(np.stack(actions))
    done = alone.walk(walker, Partial(linear, weights), bodies, seconds=SECONDS)
    np.testing.assert_allclose(done, np.stack(wanted, axis=1), atol=2e-3)
    assert np.abs(np.diff(done, axis=0)).max() > 0.05


def test_any_robot_will_do(robot):
    bodies = [CRobot("leg_rm", 3, seed) for seed in range(2)]
    done = alone.walk(alone.walker(robot), Partial(onward, jnp.array([0.01, 0.02])), bodies, seconds=SECONDS)
    expected = np.arange(1, len(done) + 1)[:, None, None] * np.array([0.01, 0.02])[None, :, None]
    np.testing.assert_allclose(done, np.broadcast_to(expected, done.shape), atol=1e-6)
    assert [len(body.positions) for body in bodies] == [8, 8]


def test_what_no_robot_senses_is_refused():
    full = alone.Walker("x", "full", K, 2.0)
    with pytest.raises(ValueError, match="observation is 'full': a robot's sensors give onboard or rates"):
        alone.walk(full, Partial(onward, jnp.zeros(1)), [CRobot("leg_rm", 3)], seconds=0.1)
