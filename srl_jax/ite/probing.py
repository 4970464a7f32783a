"""Motions by which a robot finds out what is broken, and what it feels of them: the data of `selfmodel`, from MJX."""

import jax
import jax.numpy as jnp

from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import ACTION_SIZE, CONTROL_HZ, EnvState, Hexapod
from srl_jax.env.senses import felt

LEGS, SEGMENTS = 6, 3
RAMP = 0.5  # s in which a motion grows to its full size, so that a robot at rest is not thrown
FREQUENCIES = (0.5, 1.5)  # Hz, of a leg


def probes(key: jax.Array, count: int, steps: int, *, amplitude: float = 0.5) -> jax.Array:
    """Small smooth motions about the stance: f32[P, T, 18], actions in [-amplitude, amplitude].

    Every joint follows a sinusoid of its own size and phase; the joints of a leg share a frequency and a weight, the
    square of a uniform number: some legs hardly move while others do, so that motions differ in what they tell.

    Args:
        key: random key.
        count: P.
        steps: T control steps of 1/20 s.
        amplitude: largest action of any joint, in (0, 1].

    Raises:
        ValueError: no motion, no step, or an amplitude outside (0, 1].
    """
    if count < 1 or steps < 1:
        raise ValueError(f"count is {count} and steps is {steps}; both must be at least 1.")
    if not 0.0 < amplitude <= 1.0:
        raise ValueError(f"amplitude is {amplitude}; accepted are numbers in (0, 1], 1 being full excursion.")
    leg_key, size_key, phase_key, frequency_key = jax.random.split(key, 4)
    weight = jax.random.uniform(leg_key, (count, LEGS, 1)) ** 2
    size = amplitude * weight * jax.random.uniform(size_key, (count, LEGS, SEGMENTS))
    phase = 2.0 * jnp.pi * jax.random.uniform(phase_key, (count, LEGS, SEGMENTS))
    frequency = jax.random.uniform(frequency_key, (count, LEGS, 1), jnp.float32, *FREQUENCIES)
    time = jnp.arange(1, steps + 1) / CONTROL_HZ
    angle = 2.0 * jnp.pi * frequency[:, None] * time[None, :, None, None] + phase[:, None]
    ramp = jnp.minimum(time / RAMP, 1.0)
    return (ramp[None, :, None, None] * size[:, None] * jnp.sin(angle)).reshape(count, steps, ACTION_SIZE)


def trace(robot: Hexapod, damage: Damage, actions: jax.Array, spread: jax.Array, key: jax.Array) -> jax.Array:
    """One motion of one robot in MJX, felt without sensor noise: f32[T, 24].

    Args:
        robot: from `hexapod.make`.
        damage: unbatched values.
        actions: f32[T, 18], see `probes`.
        spread: f32[] of the start's noise, 0: exactly at the stance, 1: as `EnvConfig.start_noise` says.
        key: random key of the start.
    """
    state, _ = hexapod.reset(robot, damage, key)
    state = state._replace(qpos=robot.stance + spread * (state.qpos - robot.stance))

    def advance(state: EnvState, action: jax.Array) -> tuple[EnvState, jax.Array]:
        state = hexapod.simulate(robot, damage, state, hexapod.targets(robot, action))
        return state, felt(hexapod.feel(robot, damage, state))

    return jax.lax.scan(advance, state, actions)[1]
