"""What a star-shaped robot is to the stepper: the constants of its model, arranged by the link they belong to.

A star is a floating base and L legs of up to K links in a row, each on one hinge. Legs may differ in every number; one
that has fewer links is filled up with links that weigh nothing, turn about no axis and stay where they are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import zip_longest
from typing import NamedTuple

import jax.numpy as jnp
import mujoco
import numpy as np

from srl_jax.env.star.algebra import Matrix, Scalar, Vector
from srl_jax.env.star.contacts import Model, Softness, floor_and_spheres, meeting, softness
from srl_jax.env.star.refusals import check

NO_LIMIT = 1e6  # rad or N m: finite, since 0 times infinity is not a number
FILLER = -1  # in place of the id of what a leg lacks and others have: a link, a sphere, an actuator


class Link(NamedTuple):
    """The k-th link of every leg; an entry is a number where all legs agree, else an array [L, 1]."""

    position: Vector  # m, of its frame in its parent's
    rotation: Matrix  # of its frame in its parent's, at angle 0
    axis: Vector  # of its hinge, in its own frame
    rest: Scalar  # rad, the joint's reading at angle 0
    com: Vector  # m, in its own frame
    principal: Matrix  # axes of inertia, in its own frame
    limits: tuple[Scalar, Scalar]  # rad
    control: tuple[Scalar, Scalar]  # rad


class Spheres(NamedTuple):
    """Spheres that may touch the floor: one of every leg, all on its k-th link, or those of the base."""

    link: int | None  # None: the base's
    geoms: np.ndarray  # i[n] ids, `FILLER` for a leg without
    bodies: np.ndarray  # i[n] ids of what they are fixed to, likewise
    position: Vector  # m, of their centres in the link's frame; numbers that are not 0 may be damaged


class Ids(NamedTuple):
    """Where the links' numbers stand in the model, i[K, L]; `FILLER` for links that are none."""

    body: np.ndarray
    joint: np.ndarray
    dof: np.ndarray
    qpos: np.ndarray
    actuator: np.ndarray


@dataclass(frozen=True, eq=False)
class Star:
    """A robot's constants; two are equal if they are the same object, so that it may be a static argument."""

    links: tuple[Link, ...]
    spheres: tuple[Spheres, ...]
    base_com: Vector
    base_principal: Matrix
    ids: Ids
    limited: np.ndarray  # bool[K, L] whose servos' torque keeps within a line
    friction: float
    softness: Softness  # of all contacts
    limit_softness: Softness  # of all limits
    impratio: float
    gravity: float  # m/s^2, downwards
    timestep: float  # s
    iterations: int
    search_iterations: int
    tolerance: float
    search_tolerance: float  # as the product with `tolerance`

    @property
    def legs(self) -> int:
        return self.ids.body.shape[1]


def read(model: Model) -> Star:
    """The star that `model` describes.

    Raises:
        NotAStarError: naming what the stepper cannot represent.
    """
    check(model)
    ids, option = _ids(model), model.opt
    timestep = float(option.timestep)
    floor, geoms = floor_and_spheres(model)
    met = meeting(model, floor, geoms[0])
    soft = softness(met.solref, met.solimp, timestep)
    limited = np.flatnonzero(np.asarray(model.jnt_limited))[:1]
    of_limits = [softness(model.jnt_solref[i], model.jnt_solimp[i], timestep) for i in limited]
    return Star(
        links=tuple(_link(model, Ids(*(x[k] for x in ids))) for k in range(len(ids.body))),
        spheres=_spheres(model, ids.body, geoms),
        base_com=_vector(np.asarray(model.body_ipos)[1:2]),
        base_principal=_matrix(np.asarray(model.body_iquat)[1:2]),
        ids=ids,
        limited=(np.asarray(model.actuator_forcelimited) != 0)[ids.actuator] & (ids.actuator != FILLER),
        friction=met.friction,
        softness=soft,
        limit_softness=of_limits[0] if of_limits else soft,
        impratio=float(option.impratio),
        gravity=float(-option.gravity[2]),
        timestep=timestep,
        iterations=int(option.iterations),
        search_iterations=int(option.ls_iterations),
        tolerance=float(option.tolerance),
        search_tolerance=float(option.tolerance) * float(option.ls_tolerance),
    )


def _ids(model: Model) -> Ids:
    child = {int(model.body_parentid[b]): b for b in range(2, model.nbody) if model.body_parentid[b] != 1}
    chains = []
    for body in np.flatnonzero(model.body_parentid == 1):
        chain = [int(body)]
        while chain[-1] in child:
            chain.append(child[chain[-1]])
        chains.append(chain)
    deepest = max(map(len, chains))
    body = np.array([chain + [FILLER] * (deepest - len(chain)) for chain in chains]).T
    actuator = np.full(model.njnt, FILLER)
    actuator[model.actuator_trnid[:, 0]] = np.arange(model.nu)

    def where(of_body: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        return np.where(body == FILLER, FILLER, of_body(np.maximum(body, 1)))

    joint = where(lambda b: model.body_jntadr[b])
    return Ids(
        body=body,
        joint=joint,
        dof=where(lambda b: model.body_dofadr[b]),
        qpos=where(lambda b: model.jnt_qposadr[model.body_jntadr[b]]),
        actuator=where(lambda b: actuator[model.body_jntadr[b]]),
    )


def _link(model: Model, ids: Ids) -> Link:
    """One link of every leg; `ids` are i[L]."""

    def of(field: str, index: np.ndarray, fill: float | tuple = 0.0) -> np.ndarray:
        values = np.asarray(getattr(model, field), np.float64)[index]
        return np.where((index != FILLER).reshape(-1, *(1,) * (values.ndim - 1)), values, fill)

    def between(field: str, index: np.ndarray, limited: np.ndarray) -> tuple[Scalar, Scalar]:
        free = (limited[index] == 0) | (index == FILLER)
        pair = np.where(free[:, None], (-NO_LIMIT, NO_LIMIT), of(field, index))
        return constant(pair[:, 0]), constant(pair[:, 1])

    unit = (1.0, 0.0, 0.0, 0.0)
    return Link(
        position=_vector(of("body_pos", ids.body)),
        rotation=_matrix(of("body_quat", ids.body, unit)),
        axis=_vector(of("jnt_axis", ids.joint)),
        rest=constant(of("qpos0", ids.qpos)),
        com=_vector(of("body_ipos", ids.body)),
        principal=_matrix(of("body_iquat", ids.body, unit)),
        limits=between("jnt_range", ids.joint, model.jnt_limited),
        control=between("actuator_ctrlrange", ids.actuator, model.actuator_ctrllimited),
    )


def _spheres(model: Model, body: np.ndarray, geoms: list[int]) -> tuple[Spheres, ...]:
    """The spheres that may touch the floor: those of the base, and for every leg the i-th of its k-th link.

    Those of a leg's last link count as the deepest's: the frame of a filler is that of the link it hangs on.
    """
    positions, bodies = np.asarray(model.geom_pos), model.geom_bodyid
    of_body = {b: [g for g in geoms if bodies[g] == b] for b in range(1, model.nbody)}

    def fixed(link: int | None, ids: np.ndarray) -> Spheres:
        real = ids != FILLER
        where = np.where(real[:, None], positions[ids], 0.0)
        return Spheres(link, ids, np.where(real, bodies[ids], FILLER), _vector(where))

    found = [fixed(None, np.array(of_body[1]))] if of_body[1] else []
    last = [int(chain[chain != FILLER][-1]) for chain in body.T]
    for link in range(len(body)):
        deepest = link == len(body) - 1
        own = [of_body[end if deepest else b] if deepest or b not in (end, FILLER) else []
               for b, end in zip(body[link].tolist(), last, strict=True)]  # fmt: skip
        found += [fixed(link, np.array(ids)) for ids in zip_longest(*own, fillvalue=FILLER)]
    return tuple(found)


def constant(values: np.ndarray) -> Scalar:
    """A number where all legs agree (a whole one exactly), else an array [L, 1]."""
    values = np.where(np.abs(values) < 1e-7, 0.0, np.asarray(values, np.float64))
    if np.ptp(values) < 1e-7:
        value = float(values.flat[0])
        return float(round(value)) if abs(value - round(value)) < 1e-7 else value
    return np.asarray(values, jnp.result_type(float))[:, None]


def _vector(values: np.ndarray) -> Vector:
    return [constant(x) for x in np.asarray(values).T]


def _matrix(quaternions: np.ndarray) -> Matrix:
    matrices = np.zeros((len(quaternions), 9))
    for row, quaternion in zip(matrices, np.asarray(quaternions, np.float64), strict=True):
        mujoco.mju_quat2Mat(row, quaternion / np.linalg.norm(quaternion))
    return [[constant(matrices[:, 3 * i + j]) for j in range(3)] for i in range(3)]
