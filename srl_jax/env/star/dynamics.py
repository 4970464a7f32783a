"""Inertia and smooth forces, in the torso's frame: composite rigid bodies and recursive Newton-Euler.

Featherstone, "Rigid body dynamics algorithms", 2008.
"""

import jax.numpy as jnp

from srl_jax.env.star.algebra import (
    Scalar,
    Symmetric,
    Vector,
    add,
    cross,
    dot,
    gathered,
    minus,
    plus,
    scale,
    similar,
    steiner,
    symvec,
)
from srl_jax.env.star.arrow import Arrow, Motion
from srl_jax.env.star.body import Body
from srl_jax.env.star.constants import Star
from srl_jax.env.star.kinematics import Attitude, Legs
from srl_jax.seam import Seam


def mass_matrix(star: Star, body: Body, legs: Legs, seam: Seam) -> Arrow:
    """M by composite rigid bodies: what hangs on a hinge moves as one body about it (Featherstone 2008, Sec. 6.2)."""
    count = len(star.links)
    mass, moment, inertia = 0.0, [0.0] * 3, [0.0] * 6  # of all beyond a hinge: m, m c and I about the torso's origin
    momentum: list[Vector] = [[]] * count  # of it, per unit of the hinge's speed, and
    angular: list[Vector] = [[]] * count  # its moment
    own: list[list[Scalar]] = [[0.0] * (k + 1) for k in range(count)]
    speed = [cross(legs.origin[k], legs.axis[k]) for k in range(count)]  # of the origin, were it carried along
    for k in reversed(range(count)):
        mass = add(mass, body.mass[k])
        moment = plus(moment, scale(body.mass[k], legs.com[k]))
        inertia = plus(inertia, legs.inertia[k], steiner(body.mass[k], legs.com[k]))
        mass, moment, inertia = seam((mass, moment, inertia))
        momentum[k] = plus(scale(mass, speed[k]), cross(legs.axis[k], moment))
        angular[k] = plus(symvec(inertia, legs.axis[k]), cross(moment, speed[k]))
        momentum[k], angular[k] = seam((momentum[k], angular[k]))
        for j in range(k + 1):
            own[k][j] = add(dot(legs.axis[j], angular[k]), dot(speed[j], momentum[k]))
        own[k][k] = add(own[k][k], body.armature[k])
    coupling = [[momentum[k][i] for k in range(count)] for i in range(3)]
    coupling += [[angular[k][i] for k in range(count)] for i in range(3)]
    coupling, own, mass, moment, inertia = seam((coupling, own, mass, moment, inertia))

    base_inertia = plus(_base_inertia(star, body), steiner(body.base_mass, star.base_com))
    base = _rigid(
        add(body.base_mass, gathered(mass)),
        [add(mul_, gathered(x)) for mul_, x in zip(scale(body.base_mass, star.base_com), moment, strict=True)],
        [add(x, gathered(y)) for x, y in zip(base_inertia, inertia, strict=True)],
    )
    return Arrow(base, coupling, own)


def _base_inertia(star: Star, body: Body) -> Symmetric:
    return similar(star.base_principal, list(body.base_inertia))


def _rigid(mass: Scalar, h: Vector, inertia: Symmetric) -> list[list[Scalar]]:
    """The lower triangle of a rigid body's spatial inertia about the origin; h is its first moment."""
    xx, yy, zz, xy, xz, yz = inertia
    return [
        [mass],
        [0.0, mass],
        [0.0, 0.0, mass],
        [0.0, -h[2], h[1], xx],
        [h[2], 0.0, -h[0], xy, yy],
        [-h[1], h[0], 0.0, xz, yz, zz],
    ]


def bias(star: Star, body: Body, legs: Legs, standing: Attitude, velocity: Motion, seam: Seam) -> Motion:
    """Coriolis, centrifugal and gravity forces by recursive Newton-Euler (Featherstone 2008, Sec. 5.3).

    The base is taken to accelerate upwards at g; moments are about the torso's origin.
    """
    omega = velocity.base[3:]
    lift = _lift(star, body, standing)
    turning, spin_up, acceleration = omega, [0.0] * 3, lift
    forces, moments, before = [], [], [0.0] * 3
    for k in range(len(star.links)):
        rate = scale(velocity.legs[k], legs.axis[k])
        arm = minus(legs.origin[k], before)
        acceleration = plus(acceleration, _carried(spin_up, turning, arm))
        spin_up = plus(spin_up, cross(turning, rate))
        turning = plus(turning, rate)
        acceleration, spin_up, turning = seam((acceleration, spin_up, turning))
        to_com = minus(legs.com[k], legs.origin[k])
        force = seam(scale(body.mass[k], plus(acceleration, _carried(spin_up, turning, to_com))))
        forces.append(force)
        moments.append(plus(_euler(legs.inertia[k], turning, spin_up), cross(legs.com[k], force)))
        before = legs.origin[k]

    torques: list[Scalar] = [0.0] * len(forces)
    force, moment = [0.0] * 3, [0.0] * 3
    for k in reversed(range(len(forces))):
        force, moment = plus(force, forces[k]), plus(moment, moments[k])
        lever = cross(legs.origin[k], legs.axis[k])
        torques[k] = add(dot(legs.axis[k], moment), dot(lever, force))
    torques, force, moment = seam((torques, force, moment))
    own = scale(body.base_mass, plus(lift, _carried([0.0] * 3, omega, star.base_com)))
    turn = plus(_euler(_base_inertia(star, body), omega, [0.0] * 3), cross(star.base_com, own))
    base = [add(x, gathered(y)) for x, y in zip([*own, *turn], [*force, *moment], strict=True)]
    return Motion(base, torques)


def _lift(star: Star, body: Body, standing: Attitude) -> Vector:
    """The acceleration that stands for gravity, in the torso's frame."""
    if body.gravity is None:
        return scale(star.gravity, standing.rows[2])
    return plus(*(scale(-body.gravity[i], standing.rows[i]) for i in range(3)))


def _carried(spin_up: Vector, turning: Vector, arm: Vector) -> Vector:
    """The acceleration of a point that is carried along at the end of an arm."""
    return plus(cross(spin_up, arm), cross(turning, cross(turning, arm)))


def _euler(inertia: Symmetric, turning: Vector, spin_up: Vector) -> Vector:
    """Euler's equation: the moment about the com that turns a body so."""
    return plus(symvec(inertia, spin_up), cross(turning, symvec(inertia, turning)))


def smooth_force(star: Star, body: Body, joints: list, velocity: Motion, control: list, pull: Motion) -> Motion:
    """All forces but those of constraints: servos within their torque, springs, dampers, minus the `bias`."""
    torques = []
    for k, link in enumerate(star.links):
        q, speed = joints[k], velocity.legs[k]
        target = jnp.clip(control[k], *link.control)
        push = body.gain[k] * target + body.bias[k, 0] + body.bias[k, 1] * q + body.bias[k, 2] * speed
        passive = -body.stiffness[k] * (q - body.spring[k]) - body.damping[k] * speed
        torques.append(jnp.clip(push, body.torque[k, 0], body.torque[k, 1]) + passive - pull.legs[k])
    return Motion([-x for x in pull.base], torques)
