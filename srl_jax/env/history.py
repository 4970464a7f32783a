"""The control steps that a robot has behind it, as part of what its policy sees.

A policy that sees one moment cannot know that a servo does not do what it is told; one that sees what was sensed and
done in the last steps can. The same functions serve the training program and robots outside of it.
"""

import jax
import jax.numpy as jnp

from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.interface import reading_size


def row_size(kind: str, anatomy: Anatomy = PHANTOMX) -> int:
    """Numbers of one control step: what was sensed before it, and the action."""
    return reading_size(kind, anatomy) + anatomy.action_size


def none(steps: int, kind: str, anatomy: Anatomy = PHANTOMX) -> jax.Array | None:
    """The history f32[K, R + J] of a robot that has just been put there: zeros. None for K = 0: nothing is carried.

    Args:
        steps: K.
        kind: of the observation.
        anatomy: of the robot, which has J joints.
    """
    return jnp.zeros((steps, row_size(kind, anatomy))) if steps else None


def push(history: jax.Array, reading: jax.Array, action: jax.Array) -> jax.Array:
    """The history after one control step more; the oldest is dropped, the newest stands last.

    Args:
        history: f32[K, R + J] before.
        reading: f32[R] sensed before the step, see `senses.reading`.
        action: f32[J] taken in it.
    """
    return jnp.concatenate([history[1:], jnp.concatenate([reading, action])[None]])
