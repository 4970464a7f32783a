"""Where the links are, seen from the torso: there nothing of a leg depends on how the base stands."""

from typing import NamedTuple

import jax.numpy as jnp

from srl_jax.env.star.algebra import (
    Matrix,
    Scalar,
    Symmetric,
    Vector,
    about_axis,
    dot,
    is_number,
    matmul,
    matvec,
    plus,
    similar,
    sincos,
    sub,
    total,
)
from srl_jax.env.star.body import Array, Body
from srl_jax.env.star.constants import Spheres, Star
from srl_jax.seam import Seam


class Legs(NamedTuple):
    """All legs in the torso's frame: lists by link, entries [L, B]."""

    origin: list[Vector]  # m, of the links' hinges
    axis: list[Vector]  # of the links' hinges
    com: list[Vector]  # m
    inertia: list[Symmetric]  # kg m^2, about the link's com
    spheres: list[Vector]  # m, centres of `Star.spheres`


class Attitude(NamedTuple):
    """The base's orientation."""

    quaternion: list[Scalar]  # w, x, y, z
    rows: Matrix  # of its rotation matrix: the world's axes seen from the torso

    def to_torso(self, v: Vector) -> Vector:
        return [total(self.rows[j][i] * v[j] for j in range(3)) for i in range(3)]

    def to_world(self, v: Vector) -> Vector:
        return [dot(row, v) for row in self.rows]


def attitude(quaternion: list[Scalar], seam: Seam) -> Attitude:
    """The orientation of a quaternion of any length."""
    length = jnp.sqrt(total(x * x for x in quaternion))
    w, x, y, z = (part / length for part in quaternion)
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return seam(Attitude([w, x, y, z], rows))


def legs(star: Star, body: Body, joints: list[Scalar], seam: Seam) -> Legs:
    """Forward kinematics of all legs at joint angles (rad), a list by link of [L, B]."""
    turns = seam([sincos(sub(q, link.rest)) for q, link in zip(joints, star.links, strict=True)])
    rotation, origin, axis = [], [], []
    for link, (sine, cosine) in zip(star.links, turns, strict=True):
        if rotation:
            here, at = matmul(rotation[-1], link.rotation), plus(origin[-1], matvec(rotation[-1], link.position))
        else:
            here, at = link.rotation, link.position
        turned = matmul(here, about_axis(link.axis, sine, cosine))
        turned, at, around = seam((turned, at, matvec(here, link.axis)))
        rotation.append(turned)
        origin.append(at)
        axis.append(around)

    links = range(len(star.links))
    com = [plus(origin[k], matvec(rotation[k], star.links[k].com)) for k in links]
    inertia = [similar(matmul(rotation[k], star.links[k].principal), list(body.inertia[k])) for k in links]
    spheres = [
        _centre(s, reach) if s.link is None else plus(origin[s.link], matvec(rotation[s.link], _centre(s, reach)))
        for s, reach in zip(star.spheres, body.reach, strict=True)
    ]
    com, inertia, spheres = seam((com, inertia, spheres))
    return Legs(origin, axis, com, inertia, spheres)


def _centre(spheres: Spheres, reach: Array) -> Vector:
    """In the frame of their link; what is 0 in the model stays so, which saves most of a product."""
    return [0.0 if is_number(x) and x == 0 else own for x, own in zip(spheres.position, reach, strict=True)]
