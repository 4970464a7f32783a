"""What a gait does on the simulated robot: how far it walks in 5 s, and how long each foot is on the ground.

Fitness and descriptor of Cully et al. (2015). Many gaits are walked at once, laid over all devices, and on a CPU in
blocks that fit its cache.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from jax.sharding import PartitionSpec as P

from srl_jax.blocks import blocked_map
from srl_jax.env import hexapod, physics
from srl_jax.env.anatomy import LEGS
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState, Hexapod
from srl_jax.env.model import feet, load_model
from srl_jax.env.settings import EnvConfig
from srl_jax.ite import family

STEPS = 100  # control steps of 1/20 s
BLOCK = 64  # robots stepped together on a CPU: as many as fit the cache
CLOCK_HZ = 1.0  # as published
AXIS = "gaits"


class Walk(NamedTuple):
    """What one gait did; a leading axis batches gaits."""

    fitness: jax.Array  # f32[] m along x; -inf where the robot tipped over or its belly touched the floor
    contacts: jax.Array  # i32[6] control steps at whose end the foot touched, legs rf rm rr lf lm lr
    descriptor: jax.Array  # f32[6] contacts as a share of all steps: the duty factors


class Geometry(NamedTuple):
    """Where the parts that can touch the floor are, read from the model."""

    mount: np.ndarray  # f32[6, 2] m, coxa axes in the torso
    heading: np.ndarray  # f32[6] rad, where legs point
    length: np.ndarray  # f32[3] m, coxa, femur and tibia up to the foot's centre
    foot: np.ndarray  # i[6] geoms of the feet
    belly: np.ndarray  # f32[4, 3] m, spheres under the torso
    belly_radius: float  # m


def geometry() -> Geometry:
    """The geometry of the healthy robot; damage changes none of it but the feet's radii."""
    model = load_model()
    coxae = [model.body(f"coxa_{leg}") for leg in LEGS]
    belly = [model.geom(f"belly_{leg}") for leg in ("rf", "rr", "lf", "lr")]
    length = [model.body("femur_rf").pos[0], model.body("tibia_rf").pos[0], model.geom("foot_rf").pos[0]]
    return Geometry(
        mount=np.array([coxa.pos[:2] for coxa in coxae], np.float32),
        heading=np.array([2.0 * np.arctan2(coxa.quat[3], coxa.quat[0]) for coxa in coxae], np.float32),
        length=np.array(length, np.float32),
        foot=feet(model),
        belly=np.array([geom.pos for geom in belly], np.float32),
        belly_radius=float(belly[0].size[0]),
    )


def foot_positions(parts: Geometry, joints: jax.Array) -> jax.Array:
    """Centres f32[6, 3] (m) of the feet in the torso's frame at joint angles f32[18].

    Forward kinematics of three lines; ``mjx.kinematics`` would work out all twenty bodies.
    """
    coxa, femur, tibia = joints.reshape(6, 3).T
    first, second, third = parts.length
    reach = first + second * jnp.cos(femur) + third * jnp.cos(femur + tibia)
    rise = second * jnp.sin(femur) + third * jnp.sin(femur + tibia)
    angle = parts.heading + coxa
    planar = parts.mount + reach[:, None] * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    return jnp.concatenate([planar, rise[:, None]], axis=1)


def touching(parts: Geometry, damage: Damage, qpos: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Whether each foot bool[6], and whether the belly bool[], touches the floor at a pose f32[25].

    As MuJoCo's collision of sphere and plane without margin: a sphere touches where its lowest point is not above the
    floor. A lost foot has a radius that never touches.
    """
    up = hexapod.rotation(qpos[3:7])[2]
    radius = jnp.asarray(damage.geom_size)[parts.foot, 0]
    # Sums, not matrix products, which accelerators round to 10 bits.
    height = qpos[2] + jnp.sum(foot_positions(parts, qpos[7:]) * up[None], axis=1)
    belly = qpos[2] + jnp.sum(parts.belly * up[None], axis=1)
    return height < radius, jnp.any(belly < parts.belly_radius)


def walk(robot: Hexapod, parts: Geometry, damage: Damage, gait: jax.Array, steps: int = STEPS) -> Walk:
    """One gait f32[36] for 5 s from the stance at the origin, without noise, its clock starting at 0.

    Killed where the robot tips over (`hexapod.UPRIGHT`) or one of the four belly spheres touches the floor at the end
    of a control step, or where a number is not finite.
    """
    times = jnp.arange(steps) * (robot.clock_hz / hexapod.CONTROL_HZ)
    controls = jax.vmap(lambda time: hexapod.targets(robot, family.action(gait, time)))(times)
    zeros, nothing = jnp.zeros(24), jnp.zeros(())
    start = EnvState(robot.stance, zeros, zeros, nothing, jnp.zeros((), jnp.int32), jnp.zeros(2))

    def control(carry, targets):
        state, dead, contacts = carry
        state = hexapod.simulate(robot, damage, state, targets)
        feet_down, belly_down = touching(parts, damage, state.qpos)
        fell = hexapod.rotation(state.qpos[3:7])[2, 2] < hexapod.UPRIGHT
        return (state, dead | belly_down | fell, contacts + feet_down), None

    carry = (start, jnp.zeros((), bool), jnp.zeros(6, jnp.int32))
    (state, dead, contacts), _ = jax.lax.scan(control, carry, controls)
    x = state.qpos[0]
    return Walk(jnp.where(dead | ~jnp.isfinite(x), -jnp.inf, x), contacts, contacts / steps)


def make(mesh: Mesh, clock_hz: float = CLOCK_HZ, block: int = BLOCK) -> Callable[[Damage, jax.Array], Walk]:
    """A function of a damage and gaits f32[B, 36] that walks them all; to be called under ``jit``.

    Args:
        mesh: devices, from `devices_mesh`; B must be a multiple of their number.
        clock_hz: cycles of a gait per second.
        block: robots stepped together by MJX on a CPU; otherwise all of a device's share at once.
    """
    robot, parts = hexapod.make("x", EnvConfig(), clock_hz), geometry()
    wanted = physics.together(robot.star, block) if mesh.devices.flat[0].platform == "cpu" else 0

    def rows(damage: Damage, gaits: jax.Array) -> Walk:
        batched = jax.vmap(lambda gait: walk(robot, parts, damage, gait))
        return blocked_map(batched, gaits, wanted)

    # Every device loops on its own, so what varies over the mesh is not tracked through MJX.
    return jax.shard_map(rows, mesh=mesh, in_specs=(P(), P(AXIS)), out_specs=P(AXIS), check_vma=False)


def devices_mesh(devices: int) -> Mesh:
    """A mesh of the first `devices` devices."""
    found = jax.devices()[:devices]
    mesh = jax.make_mesh((devices,), (AXIS,), (jax.sharding.AxisType.Auto,), devices=found)
    assert isinstance(mesh, Mesh)
    return mesh
