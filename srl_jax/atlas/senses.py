"""What a real robot feels, and the observation that a policy is given of it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env.hexapod import ACTION_SIZE

JOINTS, GYROSCOPE, GRAVITY = slice(0, ACTION_SIZE), slice(ACTION_SIZE, ACTION_SIZE + 3), slice(ACTION_SIZE + 3, None)
SIZE = ACTION_SIZE + 6
Array = jax.Array | np.ndarray


class Senses(NamedTuple):
    """One control step's readings: encoders, an inertial unit, and where the task is; no base velocity, no height."""

    joints: Array  # f32[18] rad about the stance; 0 where the servo does not answer
    speeds: Array  # f32[18] rad/s; 0 where the servo does not answer
    answering: Array  # bool[18] whose servos answer
    gyroscope: Array  # f32[3] rad/s, body frame
    gravity: Array  # f32[3] direction of gravity in the body frame
    towards: Array  # f32[2] unit vector in the body's plane, ahead and left, that the task rewards going along
    distance: Array  # f32[] m to the goal (p2p)
    come: Array  # f32[] m come along the task since the start, what a reward is made of; NaN: nobody tells


def felt(senses: Senses) -> jax.Array:
    """What a hypothesis must explain, f32[24]: joint angles, gyroscope, gravity."""
    return jnp.concatenate([senses.joints, senses.gyroscope, senses.gravity])


def observation(senses: Senses, phase: jax.Array, *, task: str, kind: str) -> jax.Array:
    """The observation f32[O] of `hexapod.observe`, from what is felt and the clock's phase f32[] in [0, 1).

    Raises:
        ValueError: `full`, for which no robot has the sensors.
    """
    if kind not in ("onboard", "rates"):
        raise ValueError(f"observation is {kind!r}: a robot's sensors give onboard or rates.")
    angle = 2.0 * jnp.pi * phase
    parts = [jnp.stack([jnp.sin(angle), jnp.cos(angle)]), senses.towards]
    if task == "p2p":
        parts.append(jnp.minimum(senses.distance, 2.0)[None])
    parts += [senses.gravity, senses.joints]
    if kind == "rates":
        parts += [0.3 * senses.gyroscope, 0.1 * senses.speeds]
    return jnp.concatenate(parts)
