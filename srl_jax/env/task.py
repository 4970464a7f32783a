"""The three tasks as functions of the planar position: where to go, how far one has come, what is earned for it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.env.settings import EnvConfig

CLIP = 2.0  # bound of the progress term: an exploding contact must not pay (at 20 Hz and weight 50, 0.8 m/s)


class RewardTerms(NamedTuple):
    """The named parts of the reward of one step, each f32[]; the reward is their sum."""

    progress: jax.Array
    effort: jax.Array
    goal: jax.Array
    fall: jax.Array


def sample_goal(task: str, config: EnvConfig, key: jax.Array) -> jax.Array:
    """A goal f32[2] (m) from the ring about the start, for ``p2p``; zeros otherwise."""
    if task != "p2p":
        return jnp.zeros(2)
    radius_key, angle_key = jax.random.split(key)
    radius = jax.random.uniform(radius_key, (), minval=config.goal_ring[0], maxval=config.goal_ring[1])
    angle = jax.random.uniform(angle_key, (), minval=-jnp.pi, maxval=jnp.pi)
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def distance(task: str, position: jax.Array, goal: jax.Array) -> jax.Array:
    """How far the robot has come, f32[] (m), up to a constant of the episode.

    ``x``: along the x-axis; ``xy``: from the start in any direction; ``p2p``: towards the goal.
    """
    if task == "x":
        return position[0]
    return jnp.linalg.norm(position) if task == "xy" else -jnp.linalg.norm(goal - position)


def direction(task: str, position: jax.Array, goal: jax.Array) -> jax.Array:
    """Unit vector f32[2], in the world, that the task rewards going along."""
    forward = jnp.array([1.0, 0.0])
    if task == "x":
        return forward
    # xy: outwards; the small constant along the first heading makes it defined, and smooth, at the start.
    target = position + 0.1 * forward if task == "xy" else goal - position
    return target / jnp.maximum(jnp.linalg.norm(target), 1e-6)


def succeeded(task: str, config: EnvConfig, position: jax.Array, goal: jax.Array) -> jax.Array:
    """bool[]: the goal reached (``p2p``), or `sparse_distance` covered (``x``, ``xy``)."""
    come = distance(task, position, goal)
    return come > -config.goal_radius if task == "p2p" else come >= config.sparse_distance


def ends_on_success(task: str, config: EnvConfig) -> bool:
    """Whether success terminates: where there is a goal to be absorbed by."""
    return task == "p2p" or config.reward == "sparse"


def reward_terms(
    config: EnvConfig,
    progress: jax.Array,
    action: jax.Array,
    success: jax.Array,
    fell: jax.Array,
    goal_task: bool,
) -> RewardTerms:
    """The parts of one step's reward.

    Args:
        config: weights.
        progress: f32[] metres come closer in this step.
        action: f32[J].
        success: bool[].
        fell: bool[].
        goal_task: whether success earns the bonus under the dense reward.
    """
    zero = jnp.zeros(())
    if config.reward == "sparse":
        return RewardTerms(zero, zero, success.astype(jnp.float32), zero)
    return RewardTerms(
        progress=jnp.clip(config.progress_weight * progress, -CLIP, CLIP),
        effort=-config.effort_weight * jnp.mean(jnp.square(action)),
        goal=jnp.where(success & goal_task, config.goal_bonus, 0.0),
        fall=jnp.where(fell, -config.fall_penalty, 0.0),
    )
