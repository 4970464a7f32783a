"""What damage can change of a robot, arranged as the stepper reads it, and its joints' numbers likewise."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.env.star.constants import FILLER, NO_LIMIT, Star
from srl_jax.env.star.contacts import Model

Array = jax.Array | np.ndarray
NO_LIMITS = np.array([-NO_LIMIT, NO_LIMIT])  # N m
NO_SPHERE = -1e3  # radius (m) of a sphere that a leg lacks: its surface is 1 km above its centre


class Body(NamedTuple):
    """One robot's numbers, links by legs; in the stepper every leaf has a trailing axis of robots."""

    base_mass: Array  # f[] kg
    base_inertia: Array  # f[3] kg m^2, about its principal axes
    mass: Array  # f[K, L] kg
    inertia: Array  # f[K, 3, L] kg m^2
    armature: Array  # f[K, L] kg m^2
    damping: Array  # f[K, L] N m s/rad
    stiffness: Array  # f[K, L] N m/rad
    spring: Array  # f[K, L] rad, where the spring is at rest
    limit_weight: Array  # f[K, L] inverse weight of a limit's row
    radius: tuple[Array, ...]  # f[n] m, of each of `Star.spheres`
    reach: tuple[Array, ...]  # f[3, n] m, of their centres in the link's frame
    contact_weight: tuple[Array, ...]  # f[n] inverse weight of a contact's rows
    gain: Array  # f[K, L] N m/rad
    bias: Array  # f[K, 3, L] N m, N m/rad, N m s/rad
    torque: Array  # f[K, 2, L] N m, least and most
    friction: Array | float | None = None  # f[] of sliding; None: `Star.friction`
    gravity: Array | None = None  # f[3] m/s^2 in the world; None: `Star.gravity`, downwards


class Ground(NamedTuple):
    """What a robot stands on, where it is not what its model says."""

    friction: Array  # f[] share of the model's
    down: Array  # f[3] unit vector of gravity in the world, whose z is normal to the floor


def body(star: Star, model: Model, ground: Ground | None = None) -> Body:
    """The `Body` of one robot, from a model or from any object with those of its leaves that damage changes."""
    ids, mu = star.ids, star.friction if ground is None else star.friction * ground.friction
    leaf = lambda field: jnp.asarray(getattr(model, field))  # noqa: E731
    pyramid = (1 + mu * mu) * 2 * mu * mu / star.impratio  # of the rows of a pyramidal cone
    weights = leaf("body_invweight0")[:, 0] * pyramid
    torque = by_link(leaf("actuator_forcerange"), ids.actuator)
    return Body(
        base_mass=leaf("body_mass")[1],
        base_inertia=leaf("body_inertia")[1],
        mass=by_link(leaf("body_mass"), ids.body),
        inertia=jnp.moveaxis(by_link(leaf("body_inertia"), ids.body), 2, 1),
        armature=by_link(leaf("dof_armature"), ids.dof, filler=1.0),
        damping=by_link(leaf("dof_damping"), ids.dof),
        stiffness=by_link(leaf("jnt_stiffness"), ids.joint),
        spring=by_link(leaf("qpos_spring"), ids.qpos),
        limit_weight=by_link(leaf("dof_invweight0"), ids.dof, filler=1.0),
        radius=tuple(by_link(leaf("geom_size")[:, 0], s.geoms[None], filler=NO_SPHERE)[0] for s in star.spheres),
        reach=tuple(by_link(leaf("geom_pos"), s.geoms[None])[0].T for s in star.spheres),
        contact_weight=tuple(by_link(weights, s.bodies[None], filler=1.0)[0] for s in star.spheres),
        gain=by_link(leaf("actuator_gainprm")[:, 0], ids.actuator),
        bias=jnp.moveaxis(by_link(leaf("actuator_biasprm")[:, :3], ids.actuator), 2, 1),
        torque=jnp.moveaxis(jnp.where(star.limited[..., None], torque, jnp.asarray(NO_LIMITS, torque.dtype)), 2, 1),
        friction=None if ground is None else mu,
        gravity=None if ground is None else star.gravity * ground.down,
    )


def by_link(values: jax.Array, ids: np.ndarray, filler: float = 0.0) -> jax.Array:
    """``values[ids]``: f[N, ...] -> f[K, L, ...], and `filler` where there is no id."""
    if _counts_up(ids):  # a slice costs nothing, a gather does
        rows = values[ids[0, 0] : ids[0, 0] + ids.size]
        return jnp.swapaxes(rows.reshape(*ids.T.shape, *values.shape[1:]), 0, 1)
    found = values[np.maximum(ids, 0)]
    real = (ids != FILLER).reshape(*ids.shape, *(1,) * (found.ndim - 2))
    return found if real.all() else jnp.where(real, found, filler)


def by_id(values: jax.Array, ids: np.ndarray) -> jax.Array:
    """The inverse of `by_link`: f[K, L, ...] -> f[N, ...] in the order of the ids, without the filler."""
    if _counts_up(ids):
        return jnp.swapaxes(values, 0, 1).reshape(ids.size, *values.shape[2:])
    flat = ids.ravel()
    real = np.flatnonzero(flat != FILLER)
    return values.reshape(ids.size, *values.shape[2:])[real[np.argsort(flat[real])]]


def _counts_up(ids: np.ndarray) -> bool:
    return bool(ids[0, 0] != FILLER and (ids.T.ravel() == ids[0, 0] + np.arange(ids.size)).all())
