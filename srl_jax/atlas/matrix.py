"""Who walks how well under which damage: every policy on every damaged robot, from the moment the damage strikes."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour
from srl_jax.agents.settings import ActorConfig
from srl_jax.blocks import blocked_map
from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import CONTROL_HZ, EnvState, Hexapod
from srl_jax.program import strides
from srl_jax.types import Params

BLOCK = 1024  # robots that walk at once
AHEAD = (1e3, 0.0)  # m: a goal so far away that it is a direction
SETTLE = 20  # control steps after taking over that do not count: a second


class Walked(NamedTuple):
    """Means over the walks of every policy under every damage, f32[I, D]."""

    speed: np.ndarray  # m/s
    falls: np.ndarray  # share


def measure(
    robot: Hexapod, actors: Params, damage: Damage, key: jax.Array, *, config: ActorConfig, walks: int, steps: int
) -> Walked:
    """Walks of `steps` control steps after the first second, by the training's physics.

    Args:
        robot: of the atlas' task and observation.
        actors: leaves [I, ...].
        damage: leaves [D, ...].
        key: of the starts, which are the same for all policies.
        config: the policies' architecture.
        walks: of each pair.
        steps: that count.
    """
    keys = jax.random.split(key, (len(damage.body_mass), walks))
    start = jax.jit(jax.vmap(jax.vmap(partial(strides.after_strike, robot), (None, 0))))
    starts = start(jax.tree.map(jnp.asarray, damage), keys)
    run = jax.jit(partial(_policy, robot, config, steps))
    rows = [
        jax.device_get(run(jax.tree.map(lambda x, i=i: x[i], actors), damage, starts)) for i in range(_count(actors))
    ]
    return Walked(*(np.stack(part) for part in zip(*rows, strict=True)))


def _count(actors: Params) -> int:
    return len(jax.tree.leaves(actors)[0])


def _policy(robot: Hexapod, config: ActorConfig, steps: int, actor: Params, damage: Damage, starts: EnvState):
    """Speed and falls f32[D] of one policy."""
    count, walks = starts.phase.shape
    flat = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), starts)
    each = jax.tree.map(lambda x: jnp.repeat(jnp.asarray(x), walks, axis=0), damage)
    walks_of = jax.vmap(partial(walk, robot, config, steps, actor))
    speed, fell = blocked_map(lambda rows: walks_of(*rows), (each, flat), BLOCK)
    return speed.reshape(count, walks).mean(1), fell.reshape(count, walks).mean(1)


def walk(robot: Hexapod, config: ActorConfig, steps: int, actor: Params, damage: Damage, start: EnvState):
    """Speed along x (m/s) and falls, f32[] each, of one policy from one start; a goal, if there is one, lies ahead."""
    start = start._replace(goal=jnp.array(AHEAD))

    def advance(t: jax.Array, carry: tuple[EnvState, jax.Array, jax.Array]):
        state, begun, fell = carry
        action = behaviour.policy(actor, hexapod.observe(robot, damage, state), config=config)
        state, out = hexapod.step(robot, damage, state, action)
        return state, jnp.where(t == SETTLE - 1, state.qpos[0], begun), fell | out.fell

    still = jnp.zeros(()), jnp.bool_(False)
    state, begun, fell = jax.lax.fori_loop(0, SETTLE + steps, advance, (start, *still))
    speed = jnp.where(jnp.isfinite(state.qpos[0]), state.qpos[0] - begun, 0.0) * CONTROL_HZ / steps
    return speed, (fell | ~jnp.isfinite(state.qpos[0])).astype(jnp.float32)
