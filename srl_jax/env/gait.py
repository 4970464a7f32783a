"""pi_B, scripted: a gait that steers, as a function of the observation (which has its clock), for sprawled robots."""

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env.anatomy import PHANTOMX, Anatomy


class Gait(NamedTuple):
    """Parameters of the gait; amplitudes and offsets are actions, where 1 is a joint's full excursion."""

    frequency: jax.Array  # f32[] Hz of the clock
    stride: jax.Array  # f32[] yaw amplitude of a leg that steps across its own direction
    reach: jax.Array  # f32[] last pitch amplitude of a leg that steps along its own direction
    level: jax.Array  # f32[] first pitch amplitude that keeps such a leg's foot at its height
    lift: jax.Array  # f32[] first pitch amplitude while the foot swings
    tuck: jax.Array  # f32[] last pitch amplitude while the foot swings
    press: jax.Array  # f32[] first pitch offset, downwards
    crouch: jax.Array  # f32[] last pitch offset
    lag: jax.Array  # f32[] cycles by which the lift follows the step
    turn: jax.Array  # f32[] yaw amplitude that turns the robot towards a goal straight to its left


def path(anatomy: Anatomy = PHANTOMX) -> Path:
    """The file of a robot's tuned gait."""
    return Path(__file__).parent / anatomy.gait


def load(anatomy: Anatomy = PHANTOMX) -> Gait:
    """The tuned gait of a robot (made by ``experiments/tune_gait.py``).

    Raises:
        ValueError: it has none yet, or its file is no gait's.
    """
    file = path(anatomy)
    try:
        return Gait(**{name: jnp.float32(value) for name, value in json.loads(file.read_text())["gait"].items()})
    except (OSError, LookupError, TypeError, ValueError) as error:
        raise ValueError(
            f"robot {anatomy.name!r} has no gait in {file}: make it by python -m experiments.tune_gait --robot "
            f"{anatomy.name}."
        ) from error


@cache
def walker(anatomy: Anatomy) -> Callable[[Gait, jax.Array], jax.Array]:
    """The function by which a robot walks; the same object for the same robot.

    Of a gait and an observation, of which it reads clock (0:2) and direction (2:4), it makes the action f32[J].
    Every foot steps in the goal's direction, whichever way the body faces: across its leg by the yaw, along it by the
    two pitches. So the robot walks sideways and backwards too, and turns to the goal meanwhile. Unlike turning by the
    angle to the goal, this is continuous, also where the goal is straight behind.
    """
    # A leg's positive yaw turns it counter-clockwise, seen from above.
    mount = np.deg2rad(np.array(anatomy.mounts, np.float32))
    phase = np.array(anatomy.phases, np.float32)

    def act(gait: Gait, observation: jax.Array) -> jax.Array:
        clock = jnp.arctan2(observation[0], observation[1])
        ahead, left = observation[2], observation[3]
        across = left * jnp.cos(mount) - ahead * jnp.sin(mount)
        along = ahead * jnp.cos(mount) + left * jnp.sin(mount)
        angle = clock + 2.0 * jnp.pi * phase
        swing = jnp.maximum(jnp.sin(angle - 2.0 * jnp.pi * gait.lag), 0.0)
        forward = -jnp.cos(angle)  # rises while the foot swings
        yaw = (gait.stride * across + gait.turn * left) * forward
        pitch = gait.lift * swing + gait.level * along * forward - gait.press
        last = gait.tuck * swing + gait.reach * along * forward + gait.crouch
        return jnp.clip(jnp.stack([yaw, pitch, last], axis=1).reshape(-1), -1.0, 1.0)

    return act


act = walker(PHANTOMX)
