"""The tasks that teachers are judged on are Gymnasium's, and the teachers are what they are said to be."""

from functools import partial

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import plain_loop, teaching
from experiments.teaching import TASKS


def test_the_mountain_car_is_gymnasiums():
    env, random, step = gymnasium.make("MountainCarContinuous-v0"), np.random.default_rng(0), jax.jit(teaching.swing)
    state, _ = env.reset(seed=0)
    ends = 0
    for t in range(600):
        # Swings until it is there, with a little at random; then again from the left wall.
        action = np.clip(np.sign([state[1]]) + random.uniform(-0.3, 0.3, 1), -1.0, 1.0).astype(np.float32)
        mine, reward, there = step(jnp.float32(state), action)
        state, wanted, terminated, _, _ = env.step(action)
        np.testing.assert_allclose(mine, state, atol=1e-6)
        np.testing.assert_allclose(reward, wanted, rtol=1e-5)
        assert bool(there) == terminated
        if terminated:
            ends += 1
            env.reset(seed=t)
            env.unwrapped.state = state = np.array([-1.15, -0.05])
    assert ends > 2


@pytest.mark.parametrize(("name", "good", "poor"), [("pendulum", -200.0, -1_000.0), ("mountain car", 85.0, 0.0)])
def test_a_good_teacher_can_do_it_and_a_poor_one_cannot(name, good, poor):
    task, keys = TASKS[name], jax.random.split(jax.random.key(0), 50)
    earned = {
        level: float(jax.jit(jax.vmap(partial(teaching.episode_return, task, teacher)))(keys).mean())
        for level, teacher in task.teachers.items()
    }
    assert earned["good"] > good and earned["poor"] < poor


@pytest.mark.slow
def test_a_plain_loop_learns_pendulum():
    _, returns = plain_loop.train(steps=3_000)
    assert len(returns) == 15
    assert np.mean(returns[-5:]) > -500 and returns[0] < -700


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"tasks": ("cart",)}, "tasks has 'cart': choose from pendulum, mountain car"),
        ({"methods": ("sac",)}, "methods has 'sac'"),
        ({"steps": 3}, "steps 3: at least 1, and an even number"),
    ],
)
def test_what_names_nothing_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        teaching.main(teaching.Arguments(**changed))
