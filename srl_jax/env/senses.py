"""What a real robot feels, and the observation that a policy is given of it. Imports jax only where it is used."""

from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from srl_jax.env.anatomy import JOINTS

if TYPE_CHECKING:
    import jax

SIZE = len(JOINTS) + 6  # of what the PhantomX feels
ANGLES, GYROSCOPE, GRAVITY = slice(0, len(JOINTS)), slice(len(JOINTS), len(JOINTS) + 3), slice(len(JOINTS) + 3, SIZE)
IMU = slice(GYROSCOPE.start, SIZE)  # what is left of the senses without joint encoders
# One standard deviation: encoders of hobby servos (rad) and their speeds (rad/s), a MEMS gyroscope (rad/s), and its
# estimate of the vertical.
NOISE = {"joints": 0.02, "speeds": 0.1, "gyroscope": 0.05, "gravity": 0.02}
FELT_NOISE = np.repeat(
    np.array([NOISE[x] for x in ("joints", "gyroscope", "gravity")], np.float32), (len(JOINTS), 3, 3)
)
Array: TypeAlias = "jax.Array | np.ndarray"


class Senses(NamedTuple):
    """One control step's readings: encoders, an inertial unit, and where the task is; no base velocity, no height."""

    joints: Array  # f32[J] rad about the stance; 0 where the servo does not answer
    speeds: Array  # f32[J] rad/s; 0 where the servo does not answer
    answering: Array  # bool[J] whose servos answer
    gyroscope: Array  # f32[3] rad/s, body frame
    gravity: Array  # f32[3] direction of gravity in the body frame
    towards: Array  # f32[2] unit vector in the body's plane, ahead and left, that the task rewards going along
    distance: Array  # f32[] m to the goal; p2p only
    come: Array  # f32[] m come along the task, up to a constant, what a reward is made of; NaN: nobody tells


class Beyond(NamedTuple):
    """What no sensor of a robot tells, and a simulation knows."""

    velocity: Array  # f32[3] m/s of the base, body frame
    height: Array  # f32[] m


@cache
def _jax_numpy() -> ModuleType:
    import jax.numpy

    return jax.numpy


def felt(senses: Senses) -> "jax.Array":
    """What a model of the robot must explain, f32[..., J + 6]: joint angles, gyroscope, gravity."""
    return _jax_numpy().concatenate([senses.joints, senses.gyroscope, senses.gravity], axis=-1)


def observation(
    senses: Senses,
    phase: "Array | np.floating",
    *,
    task: str,
    kind: str,
    beyond: Beyond | None = None,
    history: "Array | None" = None,
    xp: ModuleType | None = None,
) -> "jax.Array":
    """The observation f32[O], components of order one; `interface.layout` names its parts.

    First what a scripted gait needs, at fixed places: clock (sin, cos), the task's direction in the body's plane (2),
    and for p2p the distance (m, at most 2); then the `reading`; last the control steps before, if there is a history.

    Args:
        senses: what is felt.
        phase: f32[] of the gait's clock in [0, 1).
        task: x, xy or p2p.
        kind: onboard, rates or full.
        beyond: for `full`.
        history: f32[K, R + J], see `env.history`.
        xp: NumPy, where there is no jax, and its arrays are returned; None: jax.numpy.

    Raises:
        ValueError: `full`, and nobody says what no sensor tells.
    """
    xp = xp or _jax_numpy()
    angle = 2.0 * xp.pi * phase
    parts: list[Array] = [xp.stack([xp.sin(angle), xp.cos(angle)]), senses.towards]
    if task == "p2p":
        parts.append(xp.minimum(senses.distance, 2.0)[None])
    parts += _reading(senses, kind, beyond)
    if history is not None:
        parts.append(history.reshape(-1))
    return xp.concatenate(parts)


def reading(senses: Senses, *, kind: str, beyond: Beyond | None = None, xp: ModuleType | None = None) -> "jax.Array":
    """What of the observation is sensed of the body, f32[R].

    Gravity in the body frame (3) and joint angles about the stance (J). `rates` adds the gyroscope (3) and joint
    velocities (J); `full` base velocity (3, before them) and height (1, last) too. Arguments and errors as
    `observation`.
    """
    return (xp or _jax_numpy()).concatenate(_reading(senses, kind, beyond))


def _reading(senses: Senses, kind: str, beyond: Beyond | None) -> list[Array]:
    if kind == "full" and beyond is None:
        raise ValueError(f"observation is {kind!r}: a robot's sensors give onboard or rates.")
    parts: list[Array] = [senses.gravity, senses.joints]
    if beyond is not None and kind == "full":
        parts.append(beyond.velocity)
    if kind != "onboard":
        parts += [0.3 * senses.gyroscope, 0.1 * senses.speeds]
    if beyond is not None and kind == "full":
        parts.append(10.0 * beyond.height[None])
    return parts
