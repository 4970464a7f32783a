"""One physics step of many star-shaped robots at once, and the robots' arrays in the order that makes it fast."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env.star import arrow, dynamics, kinematics, newton, rows
from srl_jax.env.star.algebra import Scalar, sincos, total
from srl_jax.env.star.arrow import Motion
from srl_jax.env.star.body import Body, by_id, by_link
from srl_jax.env.star.constants import Star
from srl_jax.env.star.kinematics import Attitude
from srl_jax.seam import Seam


class State(NamedTuple):
    """What a step changes: batch first [B, ...] in the model's order outside, batch last by link inside."""

    qpos: jax.Array
    qvel: jax.Array
    warmstart: jax.Array


class Pose(NamedTuple):
    """A `State` as the step reads it: every entry has robots along its last axis."""

    base: list[Scalar]  # 7 of [B]: position (m, world), quaternion
    joints: list[Scalar]  # K of [L, B], rad
    velocity: Motion  # of the base: linear in the world, angular in the torso's frame
    warm: Motion  # the same of accelerations


def step(star: Star, body: Body, control: list[Scalar], pose: Pose, seam: Seam) -> Pose:
    """`mjx.step` of all robots: position targets (rad) as a list by link of [L, B]."""
    standing = kinematics.attitude(pose.base[3:], seam)
    velocity = _in_torso(standing, pose.velocity)
    legs = kinematics.legs(star, body, pose.joints, seam)
    mass = dynamics.mass_matrix(star, body, legs, seam)
    pull = dynamics.bias(star, body, legs, standing, velocity, seam)
    force = seam(dynamics.smooth_force(star, body, pose.joints, velocity, control, pull))
    smooth = arrow.solve(mass, force, seam)
    found = rows.find(star, body, legs, standing, pose.base[2], pose.joints, seam)
    asked = rows.reference(star, found, velocity, seam)
    problem = newton.Problem(mass, force, smooth, found, asked)
    acceleration = newton.accelerate(star, problem, _in_torso(standing, pose.warm), seam)
    return _integrate(star, standing, pose, acceleration)


def _in_torso(standing: Attitude, world: Motion) -> Motion:
    return Motion([*standing.to_torso(world.base[:3]), *world.base[3:]], world.legs)


def _integrate(star: Star, standing: Attitude, pose: Pose, acceleration: Motion) -> Pose:
    """Semi-implicit Euler: the new velocity moves the pose."""
    warm = Motion([*standing.to_world(acceleration.base[:3]), *acceleration.base[3:]], acceleration.legs)
    velocity = arrow.moved(pose.velocity, star.timestep, warm)
    base = [x + star.timestep * v for x, v in zip(pose.base[:3], velocity.base[:3], strict=True)]
    joints = [q + star.timestep * v for q, v in zip(pose.joints, velocity.legs, strict=True)]
    return Pose([*base, *_turned(standing.quaternion, velocity.base[3:], star.timestep)], joints, velocity, warm)


def _turned(quaternion: list[Scalar], omega: list[Scalar], timestep: float) -> list[Scalar]:
    """A quaternion after turning at omega (rad/s, in the torso's frame) for one time step."""
    still = (jnp.abs(omega[0]) <= 1e-8) & (jnp.abs(omega[1]) <= 1e-8) & (jnp.abs(omega[2]) <= 1e-8)
    rate = jnp.sqrt(jnp.where(still, 1.0, total(x * x for x in omega)))
    sine, cosine = sincos(jnp.where(still, 0.0, rate) * (0.5 * timestep))
    w, x, y, z = quaternion
    a, b, c, d = cosine, *(x_ * (sine / rate) for x_ in omega)
    turned = [
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    ]
    length = jnp.sqrt(total(q * q for q in turned))
    return [q / length for q in turned]


def steps(star: Star, body: Body, control: jax.Array, state: State, count: int) -> State:
    """`count` steps of B robots under constant targets; leaves are batch last: [..., B].

    Args:
        star: constants.
        body: leaves [..., B].
        control: f[nu, B] position targets (rad).
        state: leaves [nq, B] and [nv, B].
        count: steps.

    Returns:
        The new state, likewise.
    """
    # No number is above infinity, but XLA does not know that. Of the state: the model may be a constant, and be folded.
    seam = Seam(jnp.any(state.qpos > jnp.inf).astype(jnp.int32))
    ids = star.ids
    targets = list(by_link(control, ids.actuator))
    pose = Pose(
        list(state.qpos[:7]),
        list(by_link(state.qpos, ids.qpos)),
        Motion(list(state.qvel[:6]), list(by_link(state.qvel, ids.dof))),
        Motion(list(state.warmstart[:6]), list(by_link(state.warmstart, ids.dof))),
    )
    pose = jax.lax.fori_loop(0, count, lambda _, p: step(star, body, targets, p, seam), pose)

    def joined(base: list[Scalar], joints: list[Scalar], where: np.ndarray) -> jax.Array:
        return jnp.concatenate([jnp.stack(base), by_id(jnp.stack(joints), where)])

    return State(
        joined(pose.base, pose.joints, ids.qpos),
        joined(pose.velocity.base, pose.velocity.legs, ids.dof),
        joined(pose.warm.base, pose.warm.legs, ids.dof),
    )
