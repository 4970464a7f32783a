"""pi_B, scripted: a tripod gait that steers, as a function of the observation (which has its clock)."""

import json
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

DATA = Path(__file__).with_name("gait.json")

# Legs in the order rf rm rr lf lm lr. A coxa's positive yaw turns its leg counter-clockwise, seen from above.
MOUNT = np.deg2rad(np.array([-45.0, -90.0, -135.0, 45.0, 90.0, 135.0], np.float32))  # where a leg points
TRIPOD = np.array([0.0, 0.5, 0.0, 0.5, 0.0, 0.5], np.float32)  # {rf, rr, lm} and {rm, lf, lr} in antiphase


class Gait(NamedTuple):
    """Parameters of the tripod; amplitudes and offsets are actions, where 1 is a joint's full excursion."""

    frequency: jax.Array  # f32[] Hz of the clock
    stride: jax.Array  # f32[] coxa amplitude of a leg that steps across its own direction
    reach: jax.Array  # f32[] tibia amplitude of a leg that steps along its own direction
    level: jax.Array  # f32[] femur amplitude that keeps such a leg's foot at its height
    lift: jax.Array  # f32[] femur amplitude while the foot swings
    tuck: jax.Array  # f32[] tibia amplitude while the foot swings
    press: jax.Array  # f32[] femur offset, downwards
    crouch: jax.Array  # f32[] tibia offset
    lag: jax.Array  # f32[] cycles by which the lift follows the step
    turn: jax.Array  # f32[] coxa amplitude that turns the robot towards a goal straight to its left


def load(path: Path = DATA) -> Gait:
    """The tuned gait that ships with the package (made by ``experiments/tune_gait.py``)."""
    return Gait(**{name: jnp.float32(value) for name, value in json.loads(path.read_text())["gait"].items()})


def act(gait: Gait, observation: jax.Array) -> jax.Array:
    """The gait's action f32[18] at an observation, of which it reads clock (0:2) and direction (2:4).

    Every foot steps in the goal's direction, whichever way the body faces: across its leg by the coxa, along
    it by femur and tibia. So the robot walks sideways and backwards too, and turns to the goal meanwhile.
    Unlike turning by the angle to the goal, this is continuous, also where the goal is straight behind.
    """
    clock = jnp.arctan2(observation[0], observation[1])
    ahead, left = observation[2], observation[3]
    across = left * jnp.cos(MOUNT) - ahead * jnp.sin(MOUNT)
    along = ahead * jnp.cos(MOUNT) + left * jnp.sin(MOUNT)
    angle = clock + 2.0 * jnp.pi * TRIPOD
    swing = jnp.maximum(jnp.sin(angle - 2.0 * jnp.pi * gait.lag), 0.0)
    forward = -jnp.cos(angle)  # rises while the foot swings
    coxa = (gait.stride * across + gait.turn * left) * forward
    femur = gait.lift * swing + gait.level * along * forward - gait.press
    tibia = gait.tuck * swing + gait.reach * along * forward + gait.crouch
    return jnp.clip(jnp.stack([coxa, femur, tibia], axis=1).reshape(-1), -1.0, 1.0)
