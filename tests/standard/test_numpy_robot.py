"""The robot in plain NumPy observes and earns, step by step, what that of the training program does."""

import jax
import numpy as np
import pytest

from srl_jax.env import damage as damages
from srl_jax.env import hexapod, history
from srl_jax.env.hexapod import EnvState
from srl_jax.env.settings import EnvConfig
from srl_jax.standard.numpy_robot import Robot

DAMAGE = "leg_rm+tibia_lf"
TASKS = [
    ("p2p", {}),
    ("x", {"observation": "onboard"}),
    ("x", {"observation": "rates", "history": 2}),
    ("xy", {"reward": "sparse", "sparse_distance": 0.05}),
]


def state_of(robot: Robot, past: jax.Array | None) -> EnvState:
    """The NumPy robot's state as that of the package's, whose history is its own."""
    data = robot.data
    numbers = (np.array(value, np.float32) for value in (data.qpos, data.qvel, data.qacc_warmstart, robot.phase))
    return EnvState(*numbers, np.int32(robot.steps), np.float32(robot.goal), past)


@pytest.mark.parametrize(("task", "settings"), TASKS)
def test_it_observes_and_earns_what_the_program_does(task, settings):
    config, damage = EnvConfig(episode_steps=30, **settings), damages.build(DAMAGE)
    ours, random = hexapod.make(task, config, 1.5), np.random.default_rng(0)
    peer, none = Robot(task, config, DAMAGE, 1.5), history.none(config.history, config.observation)
    advance = jax.jit(lambda before, after, action: hexapod.advance(ours, damage, before, after, action))
    begun, past, ends = peer.reset(random), none, set()
    np.testing.assert_allclose(begun, hexapod.observe(ours, damage, state_of(peer, past)), atol=1e-5)
    for step in range(60):
        action = random.uniform(-1.0, 1.0, 18)
        before = state_of(peer, past)
        out = peer.step(action)
        reached, earned = advance(before, state_of(peer, past), action.astype(np.float32))
        np.testing.assert_allclose(out.observation, earned.observation, atol=1e-5)
        np.testing.assert_allclose(out.reward, earned.reward, atol=2e-4)
        for name, term in earned.terms._asdict().items():
            np.testing.assert_allclose(out.terms[name], term, atol=2e-4)
        for name in ("terminated", "truncated", "success", "fell"):
            assert getattr(out, name) == getattr(earned, name), name
        past = reached.history
        ends.add((out.terminated, out.truncated))
        if out.terminated or out.truncated:
            peer.reset(random)
            past = none
        elif step == 40:
            peer.data.qpos[2:7] = [0.2, 0.0, 1.0, 0.0, 0.0]  # upside down: it has fallen
    assert ends >= {(False, False), (True, False)}
    assert (False, True) in ends or task == "xy"  # whose goal is near


def test_a_locked_joint_starts_where_it_locked():
    robot = Robot("x", EnvConfig(), "femur_rm:locked=20", 1.5)
    robot.reset(np.random.default_rng(0))
    joint = robot.model.joint("femur_rm").qposadr[0]
    assert robot.data.qpos[joint] == pytest.approx(robot.stance[joint] + np.radians(20.0))


def test_damage_strikes_in_mid_stride_and_only_this_robot():
    robots = [Robot("x", EnvConfig(), "healthy", 1.5) for _ in range(2)]
    action = np.full(18, 0.3)
    for robot in robots:
        robot.reset(np.random.default_rng(0))
        robot.step(action)
    robots[0].strike("leg_rm")
    struck, whole = (robot.step(action).observation for robot in robots)
    silent = slice(4 + 3 + 3, 4 + 3 + 6)  # the second leg's joints, behind clock, direction and gravity
    assert not struck[silent].any() and whole[silent].all()
    assert robots[0].data.time == robots[1].data.time
