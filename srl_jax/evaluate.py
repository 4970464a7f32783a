"""Rollouts of one policy alone, outside the training program: in MJX, and in C MuJoCo as a check on it.

Both call the same `hexapod` functions for start, observation, reward and ends; only the physics between two
control steps differs.
"""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import CONTROL_HZ, EnvState, EnvStep, Hexapod
from srl_jax.env.model import mjx
from srl_jax.env.settings import EnvConfig
from srl_jax.env.star.constants import Star

Array = jax.Array | np.ndarray
Policy = Callable[[jax.Array], jax.Array]  # f32[O] -> f32[J]


class Rollout(NamedTuple):
    """One episode of at most T control steps; `rollout_mjx` adds a leading axis of keys to every field.

    Rows from ``length`` on repeat the last pose and earn nothing.
    """

    qpos: Array  # f32[T, J + 7] pose reached by each step (m, quaternion, rad)
    reward: Array  # f32[T]
    success: Array  # bool[] the goal reached at some step
    fell: Array  # bool[] tipped over
    distance: Array  # f32[] m come closer from start to end (x: along x; xy: outwards; p2p: to the goal)
    length: Array  # i32[] steps until the episode ended
    goal: Array  # f32[2] m; zeros where the task has none


def rollout_mjx(robot: Hexapod, damage: Damage, policy: Policy, keys: jax.Array, steps: int) -> Rollout:
    """Episodes in MJX, one for each key, as one compiled program.

    The program is compiled once for a policy function, task and number of steps; a policy whose parameters
    change shares it if it comes as ``jax.tree_util.Partial(function, parameters)``.

    Args:
        robot: from `hexapod.make`.
        damage: unbatched values.
        policy: observation f32[O] -> action f32[J].
        keys: [K] random keys, as for `hexapod.reset`.
        steps: T, at least 1.

    Returns:
        Rollout with a leading axis K.

    Raises:
        ValueError: if ``steps`` is below 1.
    """
    _check_steps(steps)
    return _roll(robot[:3], _as_pytree(policy), damage, keys, setting=robot[3:], steps=steps)


@partial(jax.jit, static_argnames=("setting", "steps"))
def _roll(
    arrays: tuple[mjx.Model, mjx.Data, jax.Array],
    policy: Policy,
    damage: Damage,
    keys: jax.Array,
    *,
    setting: tuple[str, EnvConfig, float, Star | None, Anatomy],
    steps: int,
) -> Rollout:
    robot = Hexapod(*arrays, *setting)

    def one(key: jax.Array) -> Rollout:
        state, observation = hexapod.reset(robot, damage, key)

        def advance(carry, _):
            state, observation, done = carry
            reached, out = hexapod.step(robot, damage, state, policy(observation))
            kept = jax.tree.map(lambda new, old: jnp.where(done, old, new), reached, state)
            row = (kept.qpos, out.reward, out.success, out.fell, out.progress, ~done)
            return (kept, out.observation, done | out.terminated | out.truncated), row

        start = (state, observation, jnp.zeros((), bool))
        _, (qpos, reward, success, fell, progress, alive) = jax.lax.scan(advance, start, None, length=steps)
        return Rollout(
            qpos=qpos,
            reward=jnp.where(alive, reward, 0.0),
            success=jnp.any(success & alive),
            fell=jnp.any(fell & alive),
            distance=jnp.sum(jnp.where(alive, progress, 0.0)),
            length=jnp.sum(alive, dtype=jnp.int32),
            goal=state.goal,
        )

    return jax.vmap(one)(keys)


def rollout_c(
    robot: Hexapod,
    damage_name: str,
    policy: Policy,
    key: jax.Array,
    steps: int,
    *,
    model: mujoco.MjModel | None = None,
) -> Rollout:
    """The episode that `rollout_mjx` gives for the same key, its physics done by C MuJoCo.

    Args:
        robot: from `hexapod.make`.
        damage_name: as `damage_names.canonical`.
        policy: observation f32[O] -> action f32[J].
        key: random key.
        steps: T, at least 1.
        model: of the damaged robot, with other physics settings; as in training where None.

    Returns:
        Rollout of NumPy arrays.

    Raises:
        ValueError: for a bad damage name, ``steps`` below 1, or a time step that does not divide 1/20 s.
    """
    _check_steps(steps)
    robot = robot._replace(config=dataclasses.replace(robot.config, randomise="none"))
    damage = damages.build(damage_name, robot.anatomy)
    model = damages.damaged_model(damage_name, robot.anatomy) if model is None else model
    substeps = _substeps(model)
    state, observation = hexapod.reset(robot, damage, key)
    goal, policy = np.asarray(state.goal), _as_pytree(policy)
    data = mujoco.MjData(model)
    data.qpos[:] = state.qpos
    act, advance = _c_functions(robot, damage)

    outs, poses = [], []
    for _ in range(steps):
        action, control = act(policy, observation)
        data.ctrl[:] = control
        mujoco.mj_step(model, data, nstep=substeps)
        state, out = jax.device_get(advance(state, _read(state, data), action))
        observation = out.observation
        outs.append(out)
        poses.append(state.qpos)
        if out.terminated or out.truncated:
            break
    return _one_rollout(outs, poses, steps, goal)


def _one_rollout(outs: list[EnvStep], poses: list[np.ndarray], steps: int, goal: np.ndarray) -> Rollout:
    """The rows of an episode that may have ended before `steps`, filled up."""
    rest = steps - len(outs)
    return Rollout(
        qpos=np.stack(poses + [poses[-1]] * rest),
        reward=np.array([out.reward for out in outs] + [0.0] * rest, np.float32),
        success=np.array(any(out.success for out in outs)),
        fell=np.array(any(out.fell for out in outs)),
        distance=np.array(sum(out.progress for out in outs), np.float32),
        length=np.array(len(outs), np.int32),
        goal=goal,
    )


def converged_model(damage_name: str, anatomy: Anatomy = PHANTOMX) -> mujoco.MjModel:
    """The damaged robot with physics settings that leave no error worth naming: 2 ms, 50 Newton iterations.

    Raises:
        ValueError: for a bad damage name.
    """
    model = damages.damaged_model(damage_name, anatomy)
    model.opt.timestep, model.opt.iterations, model.opt.ls_iterations = 0.002, 50, 50
    return model


def _c_functions(robot: Hexapod, damage: Damage) -> tuple[Callable, Callable]:
    """Jitted acting and accounting of one control step, compiled once per setting."""
    setting = robot[3:]
    return partial(_act, robot.stance, setting=setting), partial(_advance, robot.stance, damage, setting=setting)


@partial(jax.jit, static_argnames="setting")
def _act(stance: jax.Array, policy: Policy, observation: jax.Array, *, setting: tuple):
    action = policy(observation)
    return action, hexapod.targets(_bodiless(stance, setting), action)


@partial(jax.jit, static_argnames="setting")
def _advance(
    stance: jax.Array, damage: Damage, before: EnvState, after: EnvState, action: jax.Array, *, setting: tuple
):
    return hexapod.advance(_bodiless(stance, setting), damage, before, after, action)


def _bodiless(stance: jax.Array, setting: tuple) -> Hexapod:
    """A robot for the functions that need no physics, so that their programs carry no model."""
    return Hexapod(None, None, stance, *setting)  # pyright: ignore[reportArgumentType]


def _read(state: EnvState, data: mujoco.MjData) -> EnvState:
    qpos, qvel = data.qpos.astype(np.float32), data.qvel.astype(np.float32)
    return state._replace(qpos=qpos, qvel=qvel, warmstart=data.qacc_warmstart.astype(np.float32))


def _as_pytree(policy: Policy) -> Policy:
    return policy if isinstance(policy, jax.tree_util.Partial) else jax.tree_util.Partial(policy)


def _substeps(model: mujoco.MjModel) -> int:
    exact = 1.0 / (CONTROL_HZ * model.opt.timestep)
    if round(exact) < 1 or abs(exact - round(exact)) > 1e-6:
        raise ValueError(
            f"model.opt.timestep is {model.opt.timestep} s; accepted are whole fractions of the control "
            f"period, {1.0 / CONTROL_HZ} s."
        )
    return round(exact)


def _check_steps(steps: int) -> None:
    if steps < 1:
        raise ValueError(f"steps is {steps}; at least 1 is needed.")
