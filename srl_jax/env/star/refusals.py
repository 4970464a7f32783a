"""What the stepper cannot represent, refused by name: all that MuJoCo's step would compute and this one would not."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

Model = Any  # `mjx.Model` or `mujoco.MjModel`: their fields have the same names
FREE, HINGE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_HINGE)
PLANE, SPHERE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SPHERE)
EULER, NEWTON = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtSolver.mjSOL_NEWTON)
PYRAMIDAL, EULERDAMP = int(mujoco.mjtCone.mjCONE_PYRAMIDAL), int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


class NotAStarError(ValueError):
    """A model that the stepper cannot represent; the message names the part."""


def check(model: Model) -> None:
    """Raises `NotAStarError` with the first thing in `model` that the stepper would leave out or get wrong."""
    for part in (_bodies, _joints, _actuators, _options, _geoms):
        for reason in part(model):
            raise refusal(reason)


def refusal(reason: str) -> NotAStarError:
    return NotAStarError(f"the star stepper cannot represent this model: {reason}.")


def name(model: Model, kind: str, index: int) -> str:
    """What a body, joint, geom or actuator is called, in words."""
    start = getattr(model, f"name_{dict(joint='jnt').get(kind, kind)}adr")[index]
    text = bytes(model.names)[start:].split(b"\0")[0].decode()
    return f"{kind} {text or int(index)!r}"


def _values(model: Model, field: str) -> np.ndarray:
    return np.asarray(getattr(model, field))


def _where(model: Model, kind: str, wrong: Any, what: str) -> Iterator[str]:
    for index in np.flatnonzero(wrong):
        yield f"{name(model, kind, int(index))} {what}"


def _bodies(model: Model) -> Iterator[str]:
    parent, joints = model.body_parentid, model.body_jntnum
    if model.nbody < 3 or (parent[2:] == 0).any():
        yield "there must be one tree of at least two bodies on the world"
    yield from _where(model, "body", (joints != 1) & (np.arange(model.nbody) > 0), "does not have exactly one joint")
    yield from _where(model, "body", (np.bincount(parent, minlength=model.nbody)[:] > 1) & (np.arange(model.nbody) > 1),
                      "has two children: legs are chains")  # fmt: skip
    yield from _where(model, "body", _values(model, "body_gravcomp") != 0, "has gravity compensation")
    if model.neq or model.ntendon or model.npair:
        yield "it has an equality, a tendon or a contact pair"


def _joints(model: Model) -> Iterator[str]:
    kind, rest = model.jnt_type, np.arange(model.njnt) > 0
    if kind[0] != FREE:
        yield "its base has no free joint"
    yield from _where(model, "joint", rest & (kind != HINGE), "is not a hinge")
    yield from _where(model, "joint", rest & _values(model, "jnt_pos").any(1), "is not at its body's origin")
    yield from _where(model, "joint", _values(model, "jnt_margin") != 0, "has a margin")
    yield from _where(model, "joint", model.jnt_actfrclimited != 0, "limits its actuators' force")
    for field, what in (("dof_frictionloss", "friction loss"), ("dof_dampingpoly", "damping of higher order")):
        wrong = _values(model, field).reshape(model.nv, -1).any(1)
        yield from _where(model, "joint", np.isin(np.arange(model.njnt), model.dof_jntid[wrong]), f"has {what}")
    yield from _where(model, "joint", _values(model, "jnt_stiffnesspoly").any(1), "has stiffness of higher order")
    root = [_values(model, field)[:6].any() for field in ("dof_armature", "dof_damping")]
    if any(root) or _values(model, "jnt_stiffness")[0]:
        yield "its free joint has armature, damping or stiffness"


def _actuators(model: Model) -> Iterator[str]:
    joint = int(mujoco.mjtTrn.mjTRN_JOINT)
    yield from _where(model, "actuator", model.actuator_trntype != joint, "does not drive a joint")
    yield from _where(model, "actuator", model.actuator_dyntype != 0, "has dynamics")
    yield from _where(model, "actuator", model.actuator_gaintype != 0, "has a gain that is not fixed")
    yield from _where(model, "actuator", model.actuator_biastype > 1, "has a bias that is not affine")
    yield from _where(model, "actuator", _values(model, "actuator_gear")[:, 0] != 1, "has a gear")
    driven = np.bincount(model.actuator_trnid[:, 0], minlength=model.njnt)
    yield from _where(model, "joint", (driven != 1) & (np.arange(model.njnt) > 0), "does not have exactly one actuator")


def _options(model: Model) -> Iterator[str]:
    option = model.opt
    if int(option.integrator) != EULER or int(option.solver) != NEWTON or int(option.cone) != PYRAMIDAL:
        yield "it must have integrator Euler, solver Newton and pyramidal cones"
    if int(option.disableflags) != EULERDAMP or int(option.enableflags):
        yield "its flags must be the usual ones, but for eulerdamp, which must be off"
    if float(option.density) or float(option.viscosity) or np.asarray(option.gravity)[:2].any():
        yield "its medium must be a vacuum, and gravity must point down"


def _geoms(model: Model) -> Iterator[str]:
    on, to = model.geom_contype, model.geom_conaffinity
    touching = [int(g) for g in np.flatnonzero(np.asarray(on | to))]
    floors = [g for g in touching if model.geom_bodyid[g] == 0]
    if len(floors) != 1 or model.geom_type[floors[0]] != PLANE:
        yield "there must be one plane to touch, and nothing else that is fixed"
        return
    floor = floors[0]
    if _values(model, "geom_pos")[floor].any() or not np.allclose(_values(model, "geom_quat")[floor], (1, 0, 0, 0)):
        yield f"{name(model, 'geom', floor)} is not the plane z = 0"
    movers = [g for g in touching if g != floor and (on[g] & to[floor] or on[floor] & to[g])]
    if not movers:
        yield "nothing of it can touch the floor"
    for a in touching:
        rivals = [b for b in touching if b > a and floor not in (a, b) and (on[a] & to[b] or on[b] & to[a])]
        for b in rivals:
            if model.geom_bodyid[a] != model.geom_bodyid[b]:
                yield f"{name(model, 'geom', int(a))} may touch {name(model, 'geom', int(b))}"
    for geom in movers:
        if model.geom_type[geom] != SPHERE:
            yield f"{name(model, 'geom', geom)} touches the floor and is not a sphere"
    yield from _softness(model, [floor, *movers])


def _softness(model: Model, geoms: list[int]) -> Iterator[str]:
    """One friction, solref and solimp for all rows: they then are numbers instead of arrays."""
    for geom in geoms:
        for field in ("geom_solref", "geom_solimp", "geom_priority", "geom_condim"):
            if not np.allclose(_values(model, field)[geom], _values(model, field)[geoms[0]]):
                yield f"{name(model, 'geom', geom)} has another {field} than the floor"
        if _values(model, "geom_margin")[geom] or _values(model, "geom_gap")[geom]:
            yield f"{name(model, 'geom', geom)} has a margin or a gap"
        if not np.isclose(_values(model, "geom_friction")[geom, 0], _values(model, "geom_friction")[geoms[0], 0]):
            yield f"{name(model, 'geom', geom)} has another friction than the floor"
    if model.geom_condim[geoms[0]] != 3:
        yield "contacts must have condim 3"
    solref, solimp = _values(model, "geom_solref")[geoms[0]], _values(model, "geom_solimp")[geoms[0]]
    if solref[0] <= 0 or solimp[4] != 2:
        yield "solref must be a time constant and a damping ratio, and solimp's power 2"
    for field, value in (("jnt_solref", solref), ("jnt_solimp", solimp)):
        wrong = ~np.isclose(_values(model, field), value).all(1) & (np.arange(model.njnt) > 0)
        yield from _where(model, "joint", wrong, f"has another {field[4:]} than contacts")
