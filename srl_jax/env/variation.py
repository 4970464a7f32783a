"""How one robot differs from the model: drawn at every reset, as values, so that no other program is compiled.

A policy that is to walk on a real robot must not rely on what a simulation has right by chance. Floor, masses and
servos differ from robot to robot; actions come late or not at all, encoders have steps, inertial units noise and bias;
and somebody pushes. Senses and packets of a control step are drawn from the robot's seed and the number of the step, so
that whoever asks twice is told the same.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env.damage import Damage
from srl_jax.env.senses import NOISE, Senses
from srl_jax.env.star.body import Ground

LATENCY = 2  # control steps at most that an action waits
READ, SEND, PUSH = 0, 1, 2  # what of a control step is drawn
Span = tuple[float, float]


class Ranges(NamedTuple):
    """What is drawn uniformly for a robot; shares are of the model's own values."""

    mass: Span
    friction: Span
    strength: Span  # of servos: stiffness and torque
    speed: Span  # of servos without load
    damping: Span
    latency: int  # control steps at most
    noise: Span  # times `senses.NOISE`
    bias: float  # standard deviations of `NOISE` at most, of the inertial unit, the same all along
    lost: float  # share of packets at most, in either direction
    push: float  # m/s at most
    slope: float  # degrees at most, in any direction


RANGES = {
    "mild": Ranges((0.9, 1.1), (0.7, 1.1), (0.9, 1.05), (0.9, 1.1), (0.9, 1.1), 1, (0.5, 1.0), 0.5, 0.01, 0.1, 2.0),
    "wide": Ranges((0.8, 1.3), (0.4, 1.2), (0.7, 1.1), (0.7, 1.2), (0.7, 1.4), 2, (0.5, 1.5), 1.0, 0.05, 0.3, 5.0),
}
PUSHES = 0.0125  # chance a control step: one in four seconds
ENCODER = np.radians(0.29)  # what an AX-12A's tells apart


class Variation(NamedTuple):
    """One robot's draw, and the actions that are on their way to its servos."""

    seed: jax.Array  # u32[] of what is drawn at control steps
    mass: jax.Array  # f32[] shares, see `Ranges`
    strength: jax.Array
    speed: jax.Array
    damping: jax.Array
    ground: Ground
    latency: jax.Array  # i32[] control steps
    noise: jax.Array  # f32[]
    bias: jax.Array  # f32[6] rad/s of the gyroscope, and of the direction of gravity
    lost: jax.Array  # f32[] share of packets
    push: jax.Array  # f32[] m/s
    waiting: jax.Array  # f32[LATENCY, A] rad, targets that were sent last, the newest first
    held: jax.Array  # f32[A] rad, targets that the servos have


def draw(ranges: Ranges, stance: jax.Array, key: jax.Array) -> Variation:
    """Another robot, standing with targets f32[A] (rad)."""
    seed_key, share_key, bias_key, slope_key = jax.random.split(key, 4)
    spans = (*ranges[:5], ranges.noise, (0.0, ranges.lost), (0.0, ranges.push), (0.0, ranges.latency + 1.0))
    low, high = jnp.array(spans).T
    mass, friction, strength, speed, damping, noise, lost, push, latency = jax.random.uniform(
        share_key, (len(spans),), minval=low, maxval=high
    )
    tilt, way = jax.random.uniform(slope_key, (2,)) * jnp.array([np.radians(ranges.slope), 2.0 * np.pi])
    down = jnp.stack([-jnp.sin(tilt) * jnp.cos(way), -jnp.sin(tilt) * jnp.sin(way), -jnp.cos(tilt)])
    spread = jnp.repeat(jnp.array([NOISE["gyroscope"], NOISE["gravity"]]), 3)
    return Variation(
        seed=jax.random.bits(seed_key),
        mass=mass,
        strength=strength,
        speed=speed,
        damping=damping,
        ground=Ground(friction, down),
        latency=jnp.minimum(latency.astype(jnp.int32), ranges.latency),
        noise=noise,
        bias=ranges.bias * spread * jax.random.uniform(bias_key, (6,), minval=-1.0),
        lost=lost,
        push=push,
        waiting=jnp.tile(stance, (LATENCY, 1)),
        held=stance,
    )


def body(damage: Damage, own: Variation) -> Damage:
    """The leaves of a robot that is heavier, weaker or slower than the damaged model.

    Inverse weights, by which MuJoCo scales how constraints give way, follow the mass alone: rotors weigh what they do.
    """
    mass, strength = own.mass, own.strength
    return damage._replace(
        body_mass=mass * damage.body_mass,
        body_inertia=mass * damage.body_inertia,
        body_subtreemass=mass * damage.body_subtreemass,
        body_invweight0=damage.body_invweight0 / mass,
        dof_damping=damage.dof_damping * own.damping / own.speed,
        actuator_gainprm=strength * damage.actuator_gainprm,
        actuator_biasprm=strength * damage.actuator_biasprm,
        actuator_forcerange=strength * damage.actuator_forcerange,
    )


def sent(own: Variation, step: jax.Array, targets: jax.Array) -> Variation:
    """After targets f32[A] (rad) were sent: late ones wait, and a servo whose packet is lost keeps its old one.

    Args:
        own: before the control step.
        step: its number.
        targets: of the present action.
    """
    queue = jnp.concatenate([targets[None], own.waiting])
    arrived = jax.random.uniform(_key(own, step, SEND), targets.shape) >= own.lost
    return own._replace(waiting=queue[:LATENCY], held=jnp.where(arrived, queue[own.latency], own.held))


def pushed(own: Variation, step: jax.Array, velocity: jax.Array) -> jax.Array:
    """The base's velocity f32[3] (m/s, world) at the beginning of a control step: now and then somebody pushes."""
    chance, way = jax.random.uniform(_key(own, step, PUSH), (2,))
    kick = own.push * jnp.stack([jnp.cos(2.0 * np.pi * way), jnp.sin(2.0 * np.pi * way), jnp.zeros(())])
    return velocity + jnp.where(chance < PUSHES, kick, 0.0)


def read(own: Variation, step: jax.Array, senses: Senses) -> Senses:
    """What sensors say of what is: noise, a bias, an encoder's steps; a servo whose packet is lost reads 0."""
    noise_key, lost_key = jax.random.split(_key(own, step, READ))
    joints, speeds = jnp.shape(senses.joints), jnp.shape(senses.speeds)
    names = ("joints", "speeds", "gyroscope", "gravity")
    sizes = (*joints, *speeds, 3, 3)
    spread = own.noise * np.repeat(np.array([NOISE[name] for name in names], np.float32), sizes)
    off = jnp.split(spread * jax.random.normal(noise_key, (sum(sizes),)), np.cumsum(sizes)[:-1])
    heard = senses.answering & (jax.random.uniform(lost_key, joints) >= own.lost)
    return senses._replace(
        joints=jnp.where(heard, ENCODER * jnp.round(senses.joints / ENCODER) + off[0], 0.0),
        speeds=jnp.where(heard, senses.speeds + off[1], 0.0),
        answering=heard,
        gyroscope=senses.gyroscope + own.bias[:3] + off[2],
        gravity=senses.gravity + own.bias[3:] + off[3],
    )


def size(joints: int) -> int:
    """Numbers of a `Variation`."""
    return 1 + 4 + 1 + 3 + 1 + 1 + 6 + 1 + 1 + (LATENCY + 1) * joints


def _key(own: Variation, step: jax.Array, what: int) -> jax.Array:
    return jax.random.fold_in(jax.random.key(own.seed), 3 * step + what)
