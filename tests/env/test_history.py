"""The end of an observation: what was sensed and done in the control steps before, and nothing where nobody asks."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env import damage, gait, hexapod, history
from tests.env.reference import make

K, STEPS = 3, 5
KINDS = {"onboard": 21, "rates": 42, "full": 46}  # of a reading
DAMAGE = damage.build("leg_rm")
KEY = jax.random.key(0)


def wander(robot):
    """States, observations and actions of a robot that some force throws about: what is told of it is no physics."""
    advance = jax.jit(partial(hexapod.advance, robot._replace(model=None, data=None, star=None), DAMAGE))
    state, seen = hexapod.reset(robot, DAMAGE, KEY)
    rows = [(state, seen, None)]
    for key in jax.random.split(KEY, STEPS):
        action = jax.random.uniform(key, (18,), minval=-1.0)
        thrown = state._replace(
            qpos=state.qpos + 0.1 * jax.random.normal(key, (25,)), qvel=jax.random.normal(key, (24,))
        )
        state, out = advance(state, thrown, action)
        rows.append((state, out.observation, action))
    return rows


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("task", ["x", "p2p"])
def test_it_ends_with_what_was_sensed_and_done_before_and_begins_as_without(task, kind):
    size, front = KINDS[kind], 4 + (task == "p2p")
    now = front + size
    plain, robot = make(task, observation=kind), make(task, observation=kind, history=K)
    assert hexapod.observation_size(task, plain.config) == now
    assert hexapod.observation_size(task, robot.config) == now + K * (size + 18)
    rows, before = [np.zeros(size + 18, np.float32)] * K, None
    for (_, without, _), (_, seen, action) in zip(wander(plain), wander(robot), strict=True):
        assert seen.shape == (hexapod.observation_size(task, robot.config),)
        np.testing.assert_array_equal(seen[:now], without)
        if before is not None:
            rows.append(np.concatenate([before[front:now], action]))
        np.testing.assert_array_equal(seen[now:], np.concatenate(rows[-K:]))
        before = seen
    assert np.abs(np.diff(rows[K:], axis=0)).max() > 0.1


def test_nothing_is_carried_where_nothing_is_asked():
    state, _ = hexapod.reset(make("x"), DAMAGE, KEY)
    assert state.history is None and len(jax.tree.leaves(state)) == 6
    told, _ = hexapod.reset(make("x", history=K), DAMAGE, KEY)
    for name in ("qpos", "qvel", "warmstart", "phase", "steps", "goal"):
        np.testing.assert_array_equal(getattr(told, name), getattr(state, name))


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_a_states_numbers_are_counted(steps):
    robot = make("x", observation="rates", history=steps)
    state, _ = hexapod.reset(robot, DAMAGE, KEY)
    assert hexapod.state_size(robot.config) == sum(leaf.size for leaf in jax.tree.leaves(state))


def test_the_tripod_walks_whatever_it_is_told():
    robot = make("p2p", observation="onboard", history=K)
    tripod = gait.load()
    for _, seen, _ in wander(robot):
        np.testing.assert_array_equal(gait.act(tripod, seen), gait.act(tripod, seen[:5]))


def test_the_oldest_is_forgotten():
    past = jnp.arange(3.0 * history.row_size("onboard")).reshape(3, -1)
    pushed = history.push(past, jnp.full(21, -1.0), jnp.full(18, -2.0))
    np.testing.assert_array_equal(pushed[:2], past[1:])
    np.testing.assert_array_equal(pushed[2], [-1.0] * 21 + [-2.0] * 18)
