"""Constraint rows: spheres on the floor with pyramidal friction, and joints at their limits.

As MuJoCo's documentation has them ("Constraint model"). A contact has four rows, the edges ``n +- mu t`` of its
pyramid. Their Jacobian is never made: what they need of a motion is the velocity of the contact's point along normal
and tangents.
"""

from typing import NamedTuple

import jax.numpy as jnp

from srl_jax.env.star.algebra import Scalar, Vector, cross, dot, gathered, minus, mul, plus, scale, sub, total
from srl_jax.env.star.arrow import Motion
from srl_jax.env.star.body import Body
from srl_jax.env.star.constants import Star
from srl_jax.env.star.contacts import Softness
from srl_jax.env.star.kinematics import Attitude, Legs
from srl_jax.seam import Seam

TINY = 1e-15  # MuJoCo's mjMINVAL


class Contact(NamedTuple):
    """One of `Star.spheres`, entries [n, B]: n legs, or n spheres of the base."""

    point: Vector  # m, in the torso's frame
    levers: list[Vector] | None  # velocity of the point per unit of each joint's speed; None: not on a leg
    weight: Scalar  # D of its rows, 0 where it does not touch
    push: Scalar  # m/s^2 outwards that the depth asks for


class Limits(NamedTuple):
    """The joints' limits, lists by link of [L, B]."""

    weight: list[Scalar]
    push: list[Scalar]
    sign: list[Scalar]  # 1 at the lower limit, -1 at the upper


class Rows(NamedTuple):
    """All constraint rows."""

    frame: list[Vector]  # the floor's normal and tangents, seen from the torso
    friction: Scalar
    contacts: list[Contact]
    limits: Limits


class Values(NamedTuple):
    """One number for each row, before a contact's three are combined into the edges of its pyramid."""

    contacts: list[Vector]  # along normal and, times the friction, along both tangents
    limits: list[Scalar]


def find(star: Star, body: Body, legs: Legs, standing: Attitude, height: Scalar, joints: list, seam: Seam) -> Rows:
    """The rows of a pose; height (m) is that of the torso's origin."""
    ex, ey, ez = standing.rows
    frame = [ez, ey, [-x for x in ex]]  # MuJoCo's choice for a floor
    contacts = []
    for spheres, at, radius, weight in zip(star.spheres, legs.spheres, body.radius, body.contact_weight, strict=True):
        gap = height + dot(ez, at) - radius
        point = minus(at, scale(radius + 0.5 * gap, ez))  # half way between the surfaces
        strength = impedance(star.softness, gap)
        levers = None
        if spheres.link is not None:
            on = range(spheres.link + 1)
            levers = [cross(legs.axis[k], minus(point, legs.origin[k])) if k in on else [0.0] * 3
                      for k in range(len(star.links))]  # fmt: skip
        active = jnp.where(gap < 0, row_weight(weight, strength), 0.0)
        contacts.append(Contact(point, levers, active, star.softness.stiffness * strength * gap))
    friction = star.friction if body.friction is None else body.friction
    return seam(Rows(frame, friction, contacts, _limits(star, body, joints)))


def _limits(star: Star, body: Body, joints: list) -> Limits:
    weights, pushes, signs = [], [], []
    for k, link in enumerate(star.links):
        above, below = sub(joints[k], link.limits[0]), sub(link.limits[1], joints[k])
        room = jnp.minimum(above, below)
        strength = impedance(star.limit_softness, room)
        weights.append(jnp.where(room < 0, row_weight(body.limit_weight[k], strength), 0.0))
        pushes.append(star.limit_softness.stiffness * strength * room)
        signs.append(jnp.where(above < below, 1.0, -1.0))
    return Limits(weights, pushes, signs)


def impedance(soft: Softness, distance: Scalar) -> Scalar:
    """MuJoCo's impedance d(r): from least to most over the width, by two parabolas."""
    x = jnp.abs(distance) * (1 / soft.width)
    rise = jnp.where(x < soft.middle, x * x * (1 / soft.middle), 1 - (1 - x) * (1 - x) * (1 / (1 - soft.middle)))
    return jnp.where(x > 1, soft.most, jnp.clip(soft.least + rise * (soft.most - soft.least), soft.least, soft.most))


def row_weight(inverse_weight: Scalar, strength: Scalar) -> Scalar:
    """D of a row, the inverse of its regularisation."""
    return 1 / jnp.maximum(inverse_weight * (1 - strength) / strength, TINY)


def along(rows: Rows, motion: Motion, seam: Seam) -> Values:
    """``J x``."""
    linear, angular = motion.base[:3], motion.base[3:]
    points = []
    for contact in rows.contacts:
        v = plus(linear, cross(angular, contact.point))
        if contact.levers is not None:
            v = plus(v, *(scale(speed, lever) for speed, lever in zip(motion.legs, contact.levers, strict=True)))
        points.append(v)
    n, t1, t2 = rows.frame
    mu = rows.friction
    contacts = [[dot(n, v), mu * dot(t1, v), mu * dot(t2, v)] for v in seam(points)]
    return Values(contacts, [mul(sign, x) for sign, x in zip(rows.limits.sign, motion.legs, strict=True)])


def reference(star: Star, rows: Rows, velocity: Motion, seam: Seam) -> Values:
    """Minus the acceleration that every row asks for: ``b J v + k d(r) r``."""
    b, now = star.softness.damping, along(rows, velocity, seam)
    contacts = [
        [b * n + contact.push, b * t1, b * t2] for (n, t1, t2), contact in zip(now.contacts, rows.contacts, strict=True)
    ]
    limits = [star.limit_softness.damping * v + push for v, push in zip(now.limits, rows.limits.push, strict=True)]
    return seam(Values(contacts, limits))


def combined(x: Values, y: Values) -> Values:
    """The sum of both."""
    contacts = [plus(u, v) for u, v in zip(x.contacts, y.contacts, strict=True)]
    return Values(contacts, [a + b for a, b in zip(x.limits, y.limits, strict=True)])


def edges(contact: Vector) -> list[Scalar]:
    """The four rows of a contact's pyramid."""
    n, t1, t2 = contact
    return [n + t1, n - t1, n + t2, n - t2]


def cost(rows: Rows, residual: Values) -> Scalar:
    """``sum_i D_i min(r_i, 0)^2 / 2`` [B]."""
    below = lambda x: jnp.square(jnp.minimum(x, 0.0))  # noqa: E731
    sums = [
        contact.weight * total(below(edge) for edge in edges(r))
        for contact, r in zip(rows.contacts, residual.contacts, strict=True)
    ]
    sums.append(total(w * below(r) for w, r in zip(rows.limits.weight, residual.limits, strict=True)))
    return 0.5 * total(gathered(x) for x in sums)
