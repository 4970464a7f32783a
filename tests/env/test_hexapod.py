"""The environment: that its physics is MuJoCo's, and what `reset` and `step` promise."""

from functools import partial

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from srl_jax.env import damage, hexapod
from srl_jax.env.model import JOINTS
from srl_jax.env.settings import EnvConfig

STEPS = 20  # 1 s
KINDS = (
    "healthy",
    *(f"{segment}_rm{kind}" for segment in ("coxa", "femur", "tibia") for kind in ("", ":limp", ":locked")),
    *("leg_rr", "leg_lf:limp", "leg_rf+leg_lr", "tibia_rf:limp+leg_lm"),
)
CLOCK_HZ = 1.5


def tripod(phase: jax.Array) -> jax.Array:
    """An open-loop tripod gait: f32[18]."""
    angle = 2 * jnp.pi * (phase + jnp.array([0, 0.5, 0, 0.5, 0, 0.5]))
    side = jnp.array([1.0, 1, 1, -1, -1, -1])
    coxa, femur = -0.7 * side * jnp.cos(angle), 0.7 * jnp.maximum(jnp.sin(angle), 0)
    return jnp.stack([coxa, femur, jnp.zeros(6)], axis=1).reshape(-1)


@pytest.fixture(scope="module")
def robot() -> hexapod.Hexapod:
    return hexapod.make("x", EnvConfig(start_noise=0.3), CLOCK_HZ)


@pytest.fixture(scope="module")
def rollouts(robot):
    """The file's one compiled physics: a second of every kind of damage, from random states.

    First states; reached states, `EnvStep`s and actions, each [KINDS, STEPS, ...].
    """

    @jax.jit
    @jax.vmap
    def roll(values, key):
        state, _ = hexapod.reset(robot, values, key)
        free = values.dof_armature < damage.LOCK_ARMATURE
        first = state._replace(qvel=jnp.where(free, 0.3 * jax.random.normal(key, (24,)), 0.0))

        def advance(state, _):
            action = tripod(state.phase)
            after, out = hexapod.step(robot, values, state, action)
            return after, (after, out, action)

        return first, jax.lax.scan(advance, first, None, length=STEPS)[1]

    keys = jax.random.split(jax.random.key(3), len(KINDS))
    return jax.device_get(roll(damage.stack(KINDS), keys))


def make(task: str, **settings) -> hexapod.Hexapod:
    return hexapod.make(task, EnvConfig(**settings), CLOCK_HZ)


def state_at(robot, x=0.0, y=0.0, *, quaternion=(1.0, 0, 0, 0), goal=(0.0, 0.0), steps=0) -> hexapod.EnvState:
    state, _ = hexapod.reset(robot, damage.build("healthy"), jax.random.key(0))
    qpos = jnp.array([x, y, 0.11, *quaternion, *robot.stance[7:]])
    return state._replace(qpos=qpos, goal=jnp.array(goal), steps=jnp.int32(steps))


def moved(robot, start, end, action=None, **where) -> tuple[hexapod.EnvState, hexapod.EnvStep]:
    """`advance` from one place to another, without physics."""
    tilt = where.pop("quaternion", (1.0, 0, 0, 0))
    before, after = state_at(robot, *start, **where), state_at(robot, *end, quaternion=tilt, **where)
    action = jnp.zeros(18) if action is None else action
    advance = jax.jit(partial(hexapod.advance, robot._replace(model=None, data=None)))
    return advance(before, after, action)


# Physics


@pytest.mark.parametrize("name", KINDS)
def test_mjx_is_c_mujoco_at_equal_settings(robot, rollouts, name):
    first, (states, _, actions) = jax.tree.map(lambda leaf: leaf[KINDS.index(name)], rollouts)
    data = mujoco.MjData(model := damage.damaged_model(name))
    data.qpos[:], data.qvel[:] = first.qpos, first.qvel
    path = []
    for action in actions:
        data.ctrl[:] = hexapod.targets(robot, action)
        mujoco.mj_step(model, data, nstep=hexapod.SUBSTEPS)
        path.append(data.qpos.copy())
    # Measured: 1e-6 m and 5e-6 rad, single against double precision. Room is left because one Newton iteration
    # is not continuous in the state: another processor's rounding may move a touch-down by a step.
    np.testing.assert_allclose(states.qpos[:, :3], np.array(path)[:, :3], rtol=0, atol=5e-4)
    np.testing.assert_allclose(states.qpos[:, 3:], np.array(path)[:, 3:], rtol=0, atol=5e-3)
    assert np.abs(np.diff(states.qpos[:, 7:], axis=0)).max() > 0.1  # they do move


def test_the_observation_is_of_the_reached_state(robot, rollouts):
    _, (states, outs, _) = rollouts
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((states, outs)))
    assert len(np.unique(states.qpos[:, -1, 0])) == len(KINDS)
    again = jax.jit(jax.vmap(jax.vmap(partial(hexapod.observe, robot))))(states)
    np.testing.assert_allclose(outs.observation, again, atol=1e-6)


def test_the_clock_runs_and_progress_adds_up(rollouts):
    first, (states, outs, _) = rollouts
    np.testing.assert_array_equal(states.steps, np.tile(np.arange(1, STEPS + 1), (len(KINDS), 1)))
    clock = first.phase[:, None] + states.steps * CLOCK_HZ / hexapod.CONTROL_HZ
    np.testing.assert_allclose(np.cos(2 * np.pi * states.phase), np.cos(2 * np.pi * clock), atol=1e-5)
    np.testing.assert_allclose(outs.progress.sum(1), states.qpos[:, -1, 0] - first.qpos[:, 0], atol=1e-6)
    np.testing.assert_allclose(sum(outs.terms), outs.reward, atol=1e-6)


@pytest.mark.parametrize("name", [name for name in KINDS if "locked" in name])
def test_locked_joints_start_at_their_angle_and_stay(robot, rollouts, name):
    first, (states, *_) = jax.tree.map(lambda leaf: leaf[KINDS.index(name)], rollouts)
    joint = 7 + JOINTS.index(name.removesuffix(":locked"))
    assert first.qpos[joint] == robot.stance[joint]
    assert np.abs(states.qpos[:, joint] - robot.stance[joint]).max() < 1e-4
    assert (np.abs(first.qpos - robot.stance)[7:] > 0).sum() == 17


# Reset


def test_reset_stands_at_the_origin_with_noise_within_bounds():
    robot = make("p2p", start_noise=0.1)
    keys = jax.random.split(jax.random.key(0), 500)
    reset = partial(hexapod.reset, robot, damage.build("healthy"))
    states, observations = jax.jit(jax.vmap(reset))(keys)
    np.testing.assert_array_equal(states.qpos[:, :7], np.tile(robot.stance[:7], (500, 1)))
    noise = np.abs(states.qpos[:, 7:] - robot.stance[None, 7:])
    assert 0.099 < noise.max() <= 0.1 + 1e-6
    assert np.ptp(states.phase) > 0.98
    assert not states.qvel.any()
    assert not states.steps.any()
    np.testing.assert_allclose(observations[:, 4], np.linalg.norm(states.goal, axis=1), rtol=1e-5)


def test_reset_is_a_function_of_its_key():
    reset = jax.jit(partial(hexapod.reset, make("p2p"), damage.build("healthy")))
    one, same, other = (reset(jax.random.key(seed)) for seed in (4, 4, 5))
    jax.tree.map(np.testing.assert_array_equal, one, same)
    for field in ("qpos", "phase", "goal"):
        assert not np.array_equal(getattr(one[0], field), getattr(other[0], field))


def test_an_unknown_task_is_refused():
    with pytest.raises(ValueError, match="task is 'walk': choose one of x, xy, p2p"):
        make("walk")


# Observation


@pytest.mark.parametrize("task", ["x", "xy", "p2p"])
def test_observation_sizes_and_that_onboard_is_the_first_part(task):
    full, onboard = make(task), make(task, observation="onboard")
    state = state_at(full, 0.2, -0.3, quaternion=(0.8, 0, 0, 0.6), goal=(0.5, 0.5))
    state = state._replace(qvel=jnp.arange(24.0))
    seen, sensed = hexapod.observe(full, state), hexapod.observe(onboard, state)
    goal = int(task == "p2p")
    assert seen.shape == (hexapod.observation_size(task, full.config),) == (50 + goal,)
    assert sensed.shape == (hexapod.observation_size(task, onboard.config),) == (25 + goal,)
    np.testing.assert_array_equal(seen[: 25 + goal], sensed)
    still = hexapod.observe(onboard, state._replace(qvel=jnp.zeros(24)))
    np.testing.assert_array_equal(still, sensed)  # the robot has no sensor of speed


def test_observation_against_numpy():
    robot = make("p2p")
    angle, speed, joints = 0.7, np.linspace(-1, 1, 24), np.linspace(-0.2, 0.2, 18)
    state = state_at(robot, 0.1, 0.2, quaternion=(np.cos(angle / 2), 0, 0, np.sin(angle / 2)), goal=(0.5, -0.4))
    qpos = state.qpos.at[7:].add(jnp.float32(joints))
    state = state._replace(qvel=jnp.float32(speed), qpos=qpos, phase=jnp.float32(0.3))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    towards = turn.T @ [0.4, -0.6]
    expected = [
        *(np.sin(0.6 * np.pi), np.cos(0.6 * np.pi)),
        *(towards / np.hypot(*towards)),
        *(np.hypot(0.4, 0.6), 0, 0, -1, *joints),
        *(turn.T @ speed[:2], speed[2:3], 0.3 * speed[3:6], 0.1 * speed[6:], [1.1]),
    ]
    expected = np.concatenate([np.atleast_1d(part) for part in expected])
    np.testing.assert_allclose(hexapod.observe(robot, state), expected, atol=1e-5)


def test_rotation_is_mujocos():
    mujoco.mju_quat2Mat(matrix := np.zeros(9), quaternion := np.array([0.5, -0.1, 0.7, 0.5]))
    np.testing.assert_allclose(hexapod.rotation(jnp.float32(quaternion)), matrix.reshape(3, 3), atol=1e-6)


def test_targets_are_about_the_stance(robot):
    action = np.linspace(-1, 1, 18, dtype=np.float32)
    expected = np.asarray(robot.stance[7:]) + np.tile([0.6, 0.7, 0.7], 6) * action
    np.testing.assert_allclose(hexapod.targets(robot, action), expected, rtol=1e-6)


# Rewards and ends


def test_dense_reward_is_the_sum_of_its_terms():
    action = jnp.linspace(-1, 1, 18)
    _, out = moved(make("x"), (0.0, 0.0), (0.02, 0.1), action)
    expected = {"progress": 50 * 0.02, "effort": -0.05 * np.mean(np.square(action)), "goal": 0, "fall": 0}
    assert {name: float(value) for name, value in out.terms._asdict().items()} == pytest.approx(expected, rel=1e-5)
    assert float(out.reward) == pytest.approx(sum(expected.values()), rel=1e-5)
    assert float(out.progress) == pytest.approx(0.02)


def test_reaching_the_goal_terminates_with_a_bonus_and_is_no_time_out():
    robot = make("p2p", episode_steps=100)
    _, out = moved(robot, (0.0, 0.0), (0.02, 0.0), goal=(0.16, 0.0), steps=99)
    assert (bool(out.success), bool(out.terminated), bool(out.truncated)) == (True, True, False)
    assert float(out.terms.goal) == 5.0
    _, out = moved(robot, (0.0, 0.0), (0.0, 0.0), goal=(0.16, 0.0), steps=98)
    assert (bool(out.success), bool(out.terminated), bool(out.truncated)) == (False, False, False)


@pytest.mark.parametrize("task", ["x", "xy", "p2p"])
def test_time_out_truncates(task):
    robot = make(task, episode_steps=7)
    after, out = moved(robot, (0.0, 0.0), (0.01, 0.0), goal=(0.9, 0.0), steps=6)
    assert (bool(out.terminated), bool(out.truncated), int(after.steps)) == (False, True, 7)


@pytest.mark.parametrize(("reward", "penalty"), [("dense", -1.0), ("sparse", 0.0)])
def test_tipping_over_terminates(reward, penalty):
    _, out = moved(make("x", reward=reward), (0.0, 0.0), (0.0, 0.0), quaternion=(0.6, 0.8, 0, 0), steps=99)
    assert (bool(out.fell), bool(out.terminated), bool(out.truncated)) == (True, True, False)
    assert float(out.reward) == penalty


@pytest.mark.parametrize(("task", "end"), [("x", (1.0, 0.0)), ("xy", (-0.8, 0.61)), ("p2p", (0.5, 0.4))])
def test_sparse_reward_is_one_at_success_and_ends_there(task, end):
    robot = make(task, reward="sparse")
    _, out = moved(robot, (0.0, 0.0), end, jnp.ones(18), goal=(0.5, 0.5))
    assert (float(out.reward), bool(out.success), bool(out.terminated)) == (1.0, True, True)
    _, out = moved(robot, (0.0, 0.0), (0.2, 0.2), jnp.ones(18), goal=(0.5, 0.5))
    assert (float(out.reward), bool(out.success), bool(out.terminated)) == (0.0, False, False)


@pytest.mark.parametrize("task", ["x", "xy"])
def test_under_the_dense_reward_distance_alone_ends_nothing(task):
    _, out = moved(make(task), (0.99, 0.0), (1.01, 0.0))
    assert (bool(out.success), bool(out.terminated), float(out.terms.goal)) == (True, False, 0.0)
