"""pi_B, scripted: a parametric tripod gait that steers, as a function of the observation (the clock is observed)."""

import json
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp

DATA = Path(__file__).with_name("gait.json")

# Legs in the order rf rm rr lf lm lr. A coxa's positive yaw carries the foot forwards on the right, backwards on the left.
SIDE = (1.0, 1.0, 1.0, -1.0, -1.0, -1.0)
TRIPOD = (0.0, 0.5, 0.0, 0.5, 0.0, 0.5)  # {rf, rr, lm} against {rm, lf, lr}, in antiphase


class Gait(NamedTuple):
    """Parameters of the tripod; amplitudes and offsets in units of action, where 1 is the joint's full excursion."""

    frequency: jax.Array  # f32[] Hz of the clock
    stride: jax.Array  # f32[] coxa amplitude
    lift: jax.Array  # f32[] femur amplitude while the foot swings
    tuck: jax.Array  # f32[] tibia amplitude while the foot swings
    reach: jax.Array  # f32[] tibia amplitude in phase with the stride
    press: jax.Array  # f32[] femur offset while the foot stands
    crouch: jax.Array  # f32[] tibia offset
    lag: jax.Array  # f32[] cycles by which the lift follows the stride
    turn: jax.Array  # f32[] stride difference of the sides per radian of heading error


def load(path: Path = DATA) -> Gait:
    """The tuned gait that ships with the package (made by ``experiments/tune_gait.py``)."""
    return Gait(**{name: jnp.float32(value) for name, value in json.loads(path.read_text())["gait"].items()})


def act(gait: Gait, observation: jax.Array) -> jax.Array:
    """The gait's action f32[18] at an observation, of which it reads clock (0:2) and direction (2:4).

    A goal to the side makes the outer legs stride longer, one behind makes the robot turn on the spot.
    """
    clock = jnp.arctan2(observation[0], observation[1])
    ahead, left = observation[2], observation[3]
    error = jnp.arctan2(left, ahead)
    turn = jnp.clip(gait.turn * error, -1.0, 1.0)
    side = jnp.array(SIDE)
    stride = gait.stride * jnp.clip(jnp.maximum(ahead, 0.0) + side * turn, -1.0, 1.0)
    angle = clock + 2.0 * jnp.pi * jnp.array(TRIPOD)
    swing = jnp.maximum(jnp.sin(angle - 2.0 * jnp.pi * gait.lag), 0.0)
    forward = -jnp.cos(angle)  # rises while the foot swings
    coxa = side * stride * forward
    femur = gait.lift * swing - gait.press
    tibia = gait.crouch + gait.tuck * swing + gait.reach * forward
    return jnp.clip(jnp.stack([coxa, femur, tibia], axis=1).reshape(-1), -1.0, 1.0)
