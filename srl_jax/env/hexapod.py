"""A robot as a pure environment: reset and step of one, with its damage as a value.

The PhantomX unless another `anatomy` is given; J are its joints, R the numbers of a `reading`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.env import damage as damages
from srl_jax.env import history as histories
from srl_jax.env import physics, senses
from srl_jax.env import task as tasks
from srl_jax.env import variation as variations
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.damage import Damage
from srl_jax.env.interface import ACTION_SCALE as ACTION_SCALE  # of the PhantomX, for its own tools
from srl_jax.env.interface import ACTION_SIZE as ACTION_SIZE
from srl_jax.env.interface import CONTROL_HZ, SUBSTEPS, reading_size
from srl_jax.env.model import load_model, mjx, put_model, stance
from srl_jax.env.senses import Senses
from srl_jax.env.settings import TASKS, EnvConfig
from srl_jax.env.star.constants import Star
from srl_jax.env.star.stepper import State
from srl_jax.env.variation import Variation

VARIED = 1  # of a key at reset: how the robot differs from the model
UPRIGHT = 0.3  # cosine of the tilt below which the robot has tipped over


class Hexapod(NamedTuple):
    """The robot and its task; closed over, never traced."""

    model: mjx.Model
    data: mjx.Data  # a template: only positions, velocities and the solver's warm start vary
    stance: jax.Array  # f32[J + 7] standing pose
    task: str
    config: EnvConfig
    clock_hz: float  # frequency of the observed gait clock
    star: Star | None = None  # what steps the physics; None: MJX
    anatomy: Anatomy = PHANTOMX


class EnvState(NamedTuple):
    """One robot between two control steps."""

    qpos: jax.Array  # f32[J + 7] torso position (m), quaternion, joint angles (rad)
    qvel: jax.Array  # f32[J + 6] torso linear (world) and angular (body) velocity, joint velocities (rad/s)
    warmstart: jax.Array  # f32[J + 6] accelerations the solver starts from
    phase: jax.Array  # f32[] gait clock in [0, 1)
    steps: jax.Array  # i32[] control steps since reset
    goal: jax.Array  # f32[2] m, p2p only
    history: jax.Array | None = None  # f32[K, R + J] of the last control steps, where the observation tells of them
    variation: Variation | None = None  # how this robot differs from the model, where robots do


class EnvStep(NamedTuple):
    """What one control step returns; the observation is that of the reached state, before any reset."""

    observation: jax.Array  # f32[O]
    reward: jax.Array  # f32[]
    terminated: jax.Array  # bool[] goal reached or tipped over
    truncated: jax.Array  # bool[] out of time, and not terminated
    success: jax.Array  # bool[]
    fell: jax.Array  # bool[]
    progress: jax.Array  # f32[] m come closer in this step
    terms: tasks.RewardTerms


def make(task: str, config: EnvConfig, clock_hz: float, anatomy: Anatomy = PHANTOMX) -> Hexapod:
    """The robot with its task, ready for `reset` and `step`.

    Raises:
        ValueError: unknown task, or the robot's MJCF is not as its anatomy says.
    """
    if task not in TASKS:
        raise ValueError(f"task is {task!r}: choose one of {', '.join(TASKS)}.")
    c_model = load_model(anatomy)
    model = put_model(c_model)
    pose = jnp.asarray(stance(c_model), jnp.float32)
    star = physics.choose(config.physics, anatomy=anatomy)
    return Hexapod(model, mjx.make_data(c_model), pose, task, config, clock_hz, star, anatomy)


def reset(robot: Hexapod, damage: Damage, key: jax.Array) -> tuple[EnvState, jax.Array]:
    """A robot standing at the origin, its joints and clock perturbed, and its observation f32[O]."""
    joint_key, phase_key, goal_key = jax.random.split(key, 3)
    noise = robot.config.start_noise * jax.random.uniform(joint_key, (robot.anatomy.action_size,), minval=-1.0)
    free = damage.dof_armature[6:] < damages.LOCK_ARMATURE  # a locked joint starts, and stays, where it locked
    state = EnvState(
        qpos=robot.stance.at[7:].set(jnp.where(free, robot.stance[7:] + noise, damage.qpos_spring[7:])),
        qvel=jnp.zeros(6 + robot.anatomy.action_size),
        warmstart=jnp.zeros(6 + robot.anatomy.action_size),
        phase=jax.random.uniform(phase_key),
        steps=jnp.zeros((), jnp.int32),
        goal=tasks.sample_goal(robot.task, robot.config, goal_key),
        history=histories.none(robot.config.history, robot.config.observation, robot.anatomy),
        variation=_drawn(robot, key),
    )
    return state, observe(robot, damage, state)


def _drawn(robot: Hexapod, key: jax.Array) -> Variation | None:
    ranges = variations.RANGES.get(robot.config.randomise)
    return variations.draw(ranges, robot.stance[7:], jax.random.fold_in(key, VARIED)) if ranges else None


def targets(robot: Hexapod, action: jax.Array) -> jax.Array:
    """Joint position targets (rad) of an action in [-1, 1]: f32[J]."""
    return robot.stance[7:] + jnp.tile(jnp.array(robot.anatomy.action_scale), len(robot.anatomy.legs)) * action


def simulate(robot: Hexapod, damage: Damage, state: EnvState, control: jax.Array) -> EnvState:
    """One control period of physics under constant position targets f32[J]; clock and counters are left alone."""
    start, own = State(state.qpos, state.qvel, state.warmstart), state.variation
    damage, ground = (variations.body(damage, own), own.ground) if own else (damage, None)
    end = physics.simulate(robot.star, robot.model, robot.data, damage, start, control, SUBSTEPS, ground)
    return state._replace(qpos=end.qpos, qvel=end.qvel, warmstart=end.warmstart)


def step(robot: Hexapod, damage: Damage, state: EnvState, action: jax.Array) -> tuple[EnvState, EnvStep]:
    """One control step of 1/20 s, without auto-reset.

    Args:
        robot: from `make`.
        damage: unbatched values.
        state: before the step.
        action: f32[J] in [-1, 1].

    Returns:
        The reached state and what it earned.
    """
    control, begun = targets(robot, action), state
    if state.variation:
        own = variations.sent(state.variation, state.steps, control)
        qvel = state.qvel.at[:3].set(variations.pushed(own, state.steps, state.qvel[:3]))
        control, begun = own.held, state._replace(qvel=qvel, variation=own)
    after = simulate(robot, damage, begun, control)
    return advance(robot, damage, state, after, action)


def advance(
    robot: Hexapod, damage: Damage, before: EnvState, after: EnvState, action: jax.Array
) -> tuple[EnvState, EnvStep]:
    """Clock, reward and ends of a step whose physics is done; shared by MJX and C rollouts."""
    task, config = robot.task, robot.config
    phase = jnp.mod(before.phase + robot.clock_hz / CONTROL_HZ, 1.0)
    history = before.history
    if history is not None:
        history = histories.push(history, sensed(robot, damage, before), action)
    after = after._replace(phase=phase, steps=before.steps + 1, history=history)
    progress = tasks.distance(task, after.qpos[:2], after.goal) - tasks.distance(task, before.qpos[:2], before.goal)
    success = tasks.succeeded(task, config, after.qpos[:2], after.goal)
    fell = rotation(after.qpos[3:7])[2, 2] < UPRIGHT
    ends = tasks.ends_on_success(task, config)
    terminated = (success & ends) | fell
    terms = tasks.reward_terms(config, progress, action, success, fell, goal_task=ends)
    return after, EnvStep(
        observation=observe(robot, damage, after),
        reward=sum(terms, jnp.zeros(())),
        terminated=terminated,
        truncated=(after.steps >= config.episode_steps) & ~terminated,
        success=success,
        fell=fell,
        progress=progress,
        terms=terms,
    )


def rotation(quaternion: jax.Array) -> jax.Array:
    """Rotation matrix f32[3, 3], body to world, of a unit quaternion f32[4] (w, x, y, z)."""
    w, x, y, z = quaternion
    return jnp.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def feel(robot: Hexapod, damage: Damage, state: EnvState) -> Senses:
    """What is there to be sensed, without noise.

    Encoders of removed links are silent and read 0, whatever the simulation's ghosts do.
    """
    frame, present = rotation(state.qpos[3:7]), damages.present(damage)
    position = state.qpos[:2]
    heading = frame[:2, 0] / jnp.maximum(jnp.linalg.norm(frame[:2, 0]), 1e-6)
    towards = tasks.direction(robot.task, position, state.goal)
    ahead = jnp.dot(towards, heading, precision="highest")
    left = heading[0] * towards[1] - heading[1] * towards[0]
    return Senses(
        joints=jnp.where(present, state.qpos[7:] - robot.stance[7:], 0.0),
        speeds=jnp.where(present, state.qvel[6:], 0.0),
        answering=present,
        gyroscope=state.qvel[3:6],
        gravity=state.variation.ground.down @ frame if state.variation else -frame[2],
        towards=jnp.stack([ahead, left]),
        distance=-tasks.distance("p2p", position, state.goal),
        come=tasks.distance(robot.task, position, state.goal),
    )


def observe(robot: Hexapod, damage: Damage, state: EnvState) -> jax.Array:
    """The observation f32[O], see `senses.observation`."""
    velocity = _velocity(state)
    return senses.observation(
        _told(robot, damage, state),
        state.phase,
        task=robot.task,
        kind=robot.config.observation,
        beyond=senses.Beyond(velocity, state.qpos[2]),
        history=state.history,
    )


def sensed(robot: Hexapod, damage: Damage, state: EnvState) -> jax.Array:
    """What of the observation is sensed of the body, f32[R], see `senses.reading`."""
    beyond = senses.Beyond(_velocity(state), state.qpos[2])
    return senses.reading(_told(robot, damage, state), kind=robot.config.observation, beyond=beyond)


def _told(robot: Hexapod, damage: Damage, state: EnvState) -> Senses:
    """What the robot's sensors say of it."""
    felt = feel(robot, damage, state)
    return variations.read(state.variation, state.steps, felt) if state.variation else felt


def _velocity(state: EnvState) -> jax.Array:
    """Of the base, f32[3] m/s in the body frame."""
    return jnp.matmul(rotation(state.qpos[3:7]).T, state.qvel[:3], precision="highest")


def observation_size(task: str, config: EnvConfig, anatomy: Anatomy = PHANTOMX) -> int:
    """O for a task, kind of observation and history."""
    now = 4 + (task == "p2p") + reading_size(config.observation, anatomy)
    return now + config.history * histories.row_size(config.observation, anatomy)


def state_size(config: EnvConfig, anatomy: Anatomy = PHANTOMX) -> int:
    """Numbers of an `EnvState`."""
    degrees = 6 + anatomy.action_size
    varied = variations.size(anatomy.action_size) if config.randomise != "none" else 0
    history = config.history * histories.row_size(config.observation, anatomy)
    return 1 + 3 * degrees + 1 + 1 + 2 + history + varied
