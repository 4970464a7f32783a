"""Every hypothesis' own robot: moved by its model, then led back to what the real one feels.

A bank of observers, one for each damage. All take the same actions; each predicts by its own physics what will be felt,
is judged by how far off it was (`residual`), and is corrected by a share of that (`correct`), so that its unfelt parts,
base velocity and height, stay those of a robot that moves as felt. Errors do not add up over time.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp

from srl_jax.env import hexapod, senses
from srl_jax.env.damage import Damage, present
from srl_jax.env.hexapod import CONTROL_HZ, EnvState, Hexapod
from srl_jax.env.senses import ANGLES, GRAVITY, GYROSCOPE

LARGE = 10.0  # a residual that is not finite: worse than any that is felt


class Gains(NamedTuple):
    """Shares of a residual by which a hypothesis' robot is corrected."""

    joints: float = 0.3
    speeds: float = 0.1
    tilt: float = 0.2
    gyroscope: float = 0.3


GAINS = Gains()


def at_rest(robot: Hexapod, count: int) -> EnvState:
    """So many robots that stand: leaves [count, ...]."""
    still = jnp.zeros(robot.model.nv)
    none = EnvState(robot.stance, still, still, jnp.zeros(()), jnp.zeros((), jnp.int32), jnp.zeros(2))
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (count, *x.shape)), none)


def residual(robot: Hexapod, damage: Damage, state: EnvState, felt: jax.Array, answering: jax.Array) -> jax.Array:
    """What is felt f32[24] less what one hypothesis predicts; 0 where a joint is silent or the hypothesis has none."""
    error = felt - senses.felt(hexapod.feel(robot, damage, state))
    heard = jnp.concatenate([answering & present(damage), jnp.ones(6, bool)])
    return jnp.where(heard, jnp.where(jnp.isfinite(error), error, LARGE), 0.0)


def correct(state: EnvState, error: jax.Array, felt: jax.Array, gains: Gains) -> EnvState:
    """One robot, led back by shares of its residual f32[24]; joint angles, tilt and their rates."""
    vertical = -hexapod.rotation(state.qpos[3:7])[2]
    # The small turn, in the body's frame, that takes the predicted direction of gravity to the one that is felt.
    turn = gains.tilt * jnp.cross(felt[GRAVITY], vertical)
    quaternion = _product(state.qpos[3:7], jnp.concatenate([jnp.ones(1), 0.5 * turn]))
    qpos = state.qpos.at[3:7].set(quaternion / jnp.linalg.norm(quaternion)).at[7:].add(gains.joints * error[ANGLES])
    qvel = state.qvel.at[6:].add(gains.speeds * CONTROL_HZ * error[ANGLES])
    return state._replace(qpos=qpos, qvel=qvel.at[3:6].add(gains.gyroscope * error[GYROSCOPE]))


def follow(
    robot: Hexapod,
    damage: Damage,
    states: EnvState,
    action: jax.Array,
    felt: jax.Array,
    answering: jax.Array,
    gains: Gains,
) -> tuple[EnvState, jax.Array]:
    """All hypotheses over one control step: their corrected robots [D, ...], and their residuals f32[D, 24].

    Args:
        robot: whose physics the hypotheses have.
        damage: leaves [D, ...].
        states: before the step, leaves [D, ...].
        action: f32[18] taken.
        felt: f32[24] after it.
        answering: bool[18].
        gains: of the correction.
    """
    control = hexapod.targets(robot, action)
    reached = jax.vmap(lambda own, state: hexapod.simulate(robot, own, state, control))(damage, states)
    errors = jax.vmap(lambda own, state: residual(robot, own, state, felt, answering))(damage, reached)
    led = jax.vmap(lambda state, error: correct(state, error, felt, gains))(reached, errors)
    sound = jnp.all(jnp.isfinite(led.qpos), axis=1) & jnp.all(jnp.isfinite(led.qvel), axis=1)
    return jax.vmap(lambda ok, *both: jax.tree.map(partial(jnp.where, ok), *both))(sound, led, states), errors


def _product(a: jax.Array, b: jax.Array) -> jax.Array:
    """Of two quaternions f32[4] (w, x, y, z)."""
    w, v = a[0] * b[0] - jnp.dot(a[1:], b[1:]), a[0] * b[1:] + b[0] * a[1:] + jnp.cross(a[1:], b[1:])
    return jnp.concatenate([w[None], v])
