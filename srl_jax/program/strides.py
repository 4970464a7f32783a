"""Where a policy must take over: robots that were walking when their damage struck, as starts of episodes.

A healthy robot walks by its gait for half a second to two, its damage strikes, and the gait goes on for up to a
second, as a robot would that does not yet know. What comes of it, at any phase, turned and crouched, is kept.
"""

from functools import partial

import jax
import jax.numpy as jnp

from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState, Hexapod
from srl_jax.program.state import tuned_gait

COUNT = 32  # of every damage of a row
WALK = (10, 40)  # control steps before the damage strikes
UNAWARE = 20  # control steps at most that the gait goes on after it
TAKE, PICK = 2, 3  # of a robot's key (4: `mix`): whether it starts in mid-stride, and from which


def after_strike(robot: Hexapod, damage: Damage, key: jax.Array) -> EnvState:
    """One robot, at the origin, some time after its damage has struck in mid-stride; a standing one where it fell."""
    reset_key, walk_key, unaware_key = jax.random.split(key, 3)
    struck = jax.random.randint(walk_key, (), *WALK)
    end = struck + jax.random.randint(unaware_key, (), 0, UNAWARE + 1)
    healthy = jax.tree.map(jnp.asarray, damages.build(damage_names.HEALTHY, robot.anatomy))
    standing, _ = hexapod.reset(robot, damage, reset_key)
    begun, _ = hexapod.reset(robot, healthy, reset_key)
    walk = tuned_gait(robot.anatomy)

    def advance(t: jax.Array, carry: tuple[EnvState, jax.Array]) -> tuple[EnvState, jax.Array]:
        state, upright = carry
        present = jax.tree.map(lambda old, new: jnp.where(t < struck, old, new), healthy, damage)
        reached, out = hexapod.step(robot, present, state, walk(hexapod.observe(robot, present, state)))
        state = jax.tree.map(lambda old, new: jnp.where(t < end, new, old), state, reached)
        return state, upright & ~(out.fell & (t < end))

    walked, upright = jax.lax.fori_loop(0, WALK[1] + UNAWARE, advance, (begun, jnp.bool_(True)))
    upright &= jnp.isfinite(walked.qpos).all() & jnp.isfinite(walked.qvel).all()
    walked = walked._replace(qpos=walked.qpos.at[:2].set(0.0))
    return jax.tree.map(lambda old, new: jnp.where(upright, new, old), standing, walked)


def turned(state: EnvState, angle: jax.Array) -> EnvState:
    """The same motion from the origin, in another direction: everything turned about the vertical, f32[] rad."""
    cosine, sine, half = jnp.cos(angle), jnp.sin(angle), 0.5 * angle

    def along(vector: jax.Array) -> jax.Array:
        x, y = vector[0], vector[1]
        return vector.at[:2].set(jnp.stack([cosine * x - sine * y, sine * x + cosine * y]))

    w, x, y, z = state.qpos[3:7]
    a, b = jnp.cos(half), jnp.sin(half)
    quaternion = jnp.stack([a * w - b * z, a * x - b * y, a * y + b * x, a * z + b * w])
    qpos = state.qpos.at[:2].set(0.0).at[3:7].set(quaternion)
    return state._replace(qpos=qpos, qvel=along(state.qvel), warmstart=along(state.warmstart))


def make(robot: Hexapod, damage: Damage, keys: jax.Array) -> EnvState:
    """`COUNT` such robots of every row: leaves [R, COUNT, ...], from damages [R, ...] and keys key[R]."""
    return _make(tuple(robot[:3]), damage, keys, setting=tuple(robot[3:]))


@partial(jax.jit, static_argnames="setting")
def _make(arrays: tuple, damage: Damage, keys: jax.Array, *, setting: tuple) -> EnvState:
    """Traced once for a robot's setting, however often damage changes."""
    robot = Hexapod(*arrays, *setting)
    each = jax.vmap(lambda key: jax.random.split(key, COUNT))(keys)
    return jax.vmap(jax.vmap(partial(after_strike, robot), (None, 0)))(damage, each)


def begin(robot: Hexapod, starts: EnvState, fresh: EnvState, key: jax.Array) -> EnvState:
    """`fresh`, or with the chance of `stride_starts` one of its row's `starts` with the goal of `fresh`."""
    index = jax.random.randint(jax.random.fold_in(key, PICK), (), 0, COUNT)
    taken = jax.random.bernoulli(jax.random.fold_in(key, TAKE), robot.config.stride_starts)
    walking = jax.tree.map(lambda leaf: leaf[index], starts)._replace(
        steps=fresh.steps, goal=fresh.goal, variation=fresh.variation
    )
    return jax.tree.map(lambda old, new: jnp.where(taken, new, old), fresh, walking)
