"""The open-loop gaits of intelligent trial and error: 36 numbers in [0, 1] that say how six legs swing.

Cully, Clune, Tarapore & Mouret (Nature 2015, supplementary S2), as in the public ``resibots/hexapod_common``. A leg has
(amplitude, phase, duty) for its coxa and again for its femur: a square wave that is +amplitude for the first `duty` of
the period, -amplitude afterwards, smoothed by a Gaussian around the circle and shifted by `phase`. The tibia does the
opposite of the femur, which keeps it upright.

The period is one cycle of the clock, 1 s as published. Angles differ from the published ones, which fit another
robot: an amplitude of 1 is this robot's full excursion, 0.6 rad of coxa (there pi/8) and 0.7 rad of femur and tibia
(there pi/4) about the stance. The literature numbers the legs around the body (``pexod.urdf``); as its reference tripod
walks forward, they are right front, middle, rear, then left rear, middle, front. Signs need no change: there and here
all coxae turn counter-clockwise, and a femur's positive angle lifts its foot.
"""

import chex
import jax
import jax.numpy as jnp
import numpy as np

GENES = 36
SAMPLES = 100  # of a period
HALF_WIDTH = 10  # samples on either side that the filter averages
SIGMA = 3.0  # samples
ORDER = ("rf", "rm", "rr", "lr", "lm", "lf")  # the literature's legs 0..5
ROWS = np.array([0, 1, 2, 5, 4, 3])  # leg i of this robot (rf rm rr lf lm lr) is the literature's ROWS[i]

# The published tripod, in the literature's order: coxa (amplitude, phase, duty), then femur.
REFERENCE = np.array(
    [
        *(1.00, 0.00, 0.50, 0.25, 0.25, 0.50),
        *(1.00, 0.50, 0.50, 0.25, 0.75, 0.50),
        *(1.00, 0.00, 0.50, 0.25, 0.25, 0.50),
        *(1.00, 0.00, 0.50, 0.25, 0.75, 0.50),
        *(1.00, 0.50, 0.50, 0.25, 0.25, 0.50),
        *(1.00, 0.00, 0.50, 0.25, 0.75, 0.50),
    ],
    np.float32,
)

OFFSETS = np.arange(-HALF_WIDTH, HALF_WIDTH + 1)
WEIGHTS = np.exp(-0.5 * (OFFSETS / SIGMA) ** 2)
WEIGHTS = np.float32(WEIGHTS / WEIGHTS.sum())
ROUNDING = 1e-3  # samples: multiples of 0.01 must not fall short of their sample in f32


def action(parameters: jax.Array, phase: jax.Array | float) -> jax.Array:
    """The action f32[18] in [-1, 1] of a gait at a clock phase f32[] in cycles.

    Exact at the 100 samples of a period, and linear in between. At 20 control steps a cycle every step is a sample.

    Args:
        parameters: f32[36] in [0, 1], legs in the literature's order, (coxa, femur) x (amplitude, phase, duty).
        phase: of the clock; whole cycles do not matter.
    """
    chex.assert_shape(parameters, (GENES,))
    place = SAMPLES * jnp.mod(phase, 1.0)
    before = jnp.floor(place)
    both = samples(parameters, jnp.stack([before, before + 1.0]).astype(jnp.int32))
    return both[0] + (place - before) * (both[1] - both[0])


def table(parameters: jax.Array) -> jax.Array:
    """A whole period of actions f32[100, 18]; row k is `action` at phase k / 100. To be made once per episode."""
    chex.assert_shape(parameters, (GENES,))
    return samples(parameters, jnp.arange(SAMPLES))


def samples(parameters: jax.Array, index: jax.Array) -> jax.Array:
    """Actions f32[n, 18] at samples i32[n] of the period."""
    signals = parameters.reshape(6, 2, 3)[ROWS]  # this robot's legs, coxa and femur
    amplitude, shift, duty = signals[..., 0], signals[..., 1], signals[..., 2]
    start, rises = (jnp.floor(SAMPLES * x + ROUNDING).astype(jnp.int32) for x in (shift, duty))
    place = index[:, None] + OFFSETS[None]  # [n, 21]
    place = jnp.mod(place[:, None, None, :] + start[None, :, :, None], SAMPLES)  # [n, 6, 2, 21]
    weights = jnp.broadcast_to(WEIGHTS, place.shape)
    smooth = jnp.sum(jnp.where(place < rises[None, :, :, None], weights, -weights), axis=-1)
    coxa, femur = jnp.moveaxis(amplitude[None] * smooth, -1, 0)
    return jnp.stack([coxa, femur, -femur], axis=-1).reshape(len(index), -1)
