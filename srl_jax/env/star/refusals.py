"""What the stepper cannot represent, refused by name: all that `mjx.step` would compute and this one would not."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np

from srl_jax.env.star.contacts import Model, floor_and_spheres, meeting, pairs

FREE, HINGE = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_HINGE)
PLANE, SPHERE = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_SPHERE)
EULER, NEWTON = int(mujoco.mjtIntegrator.mjINT_EULER), int(mujoco.mjtSolver.mjSOL_NEWTON)
PYRAMIDAL, EULERDAMP = int(mujoco.mjtCone.mjCONE_PYRAMIDAL), int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
# Flags that change nothing of what the stepper does: sensors, and how C MuJoCo goes about what MJX does otherwise.
HARMLESS = sum(
    int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    for flag in ("SENSOR", "MIDPHASE", "AUTORESET", "NATIVECCD", "ISLAND", "MULTICCD")
)


class NotAStarError(ValueError):
    """A model that the stepper cannot represent; the message names the part."""


def check(model: Model) -> None:
    """Raises `NotAStarError` with the first thing in `model` that the stepper would leave out or get wrong."""
    for part in (_bodies, _joints, _actuators, _options, _geoms, _softness):
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
    parent, joints, number = model.body_parentid, model.body_jntnum, np.arange(model.nbody)
    if model.nbody < 3 or (parent[2:] == 0).any():
        yield "there must be one tree of at least two bodies on the world"
    yield from _where(model, "body", (joints != 1) & (number > 0), "does not have exactly one joint")
    children = np.bincount(parent, minlength=model.nbody)
    yield from _where(model, "body", (children > 1) & (number > 1), "has two children, but legs are chains")
    yield from _where(model, "body", _values(model, "body_gravcomp") != 0, "has gravity compensation")
    for count, what in ((model.neq, "an equality"), (model.ntendon, "a tendon"), (model.npair, "a contact pair")):
        if count:
            yield f"it has {what}"


def _joints(model: Model) -> Iterator[str]:
    kind, rest = model.jnt_type, np.arange(model.njnt) > 0
    if kind[0] != FREE:
        yield "its base has no free joint"
    yield from _where(model, "joint", rest & (kind != HINGE), "is not a hinge")
    yield from _where(model, "joint", rest & _values(model, "jnt_pos").any(1), "is not at its body's origin")
    yield from _where(model, "joint", (model.jnt_limited != 0) & (_values(model, "jnt_margin") != 0), "has a margin")
    yield from _where(model, "joint", model.jnt_actfrclimited != 0, "limits its actuators' force")
    for field, what in (("dof_frictionloss", "friction loss"), ("dof_dampingpoly", "damping of higher order")):
        wrong = _values(model, field).reshape(model.nv, -1).any(1)
        yield from _where(model, "joint", np.isin(np.arange(model.njnt), model.dof_jntid[wrong]), f"has {what}")
    yield from _where(model, "joint", _values(model, "jnt_stiffnesspoly").any(1), "has stiffness of higher order")
    root = _values(model, "jnt_stiffness")[0], *(_values(model, f"dof_{x}")[:6].any() for x in ("armature", "damping"))
    if any(root):
        yield f"{name(model, 'joint', 0)} carries the base and has armature, damping or stiffness"


def _actuators(model: Model) -> Iterator[str]:
    joint, none = int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtBias.mjBIAS_NONE)
    if not model.nu:
        yield "it has no actuator"
    yield from _where(model, "actuator", model.actuator_trntype != joint, "does not drive a joint")
    yield from _where(model, "actuator", model.actuator_dyntype != 0, "has dynamics")
    yield from _where(model, "actuator", model.actuator_gaintype != 0, "has a gain that is not fixed")
    bias, numbers = model.actuator_biastype, _values(model, "actuator_biasprm")[:, :3]
    wrong = (bias > 1) | ((bias == none) & numbers.any(1))
    yield from _where(model, "actuator", wrong, "has a bias that is not affine")
    yield from _where(model, "actuator", _values(model, "actuator_gear")[:, 0] != 1, "has a gear")
    driven = np.bincount(model.actuator_trnid[:, 0], minlength=model.njnt)
    yield from _where(model, "joint", driven > 1, "has two actuators")
    if driven[0]:
        yield f"{name(model, 'joint', 0)} carries the base and has an actuator"


def _options(model: Model) -> Iterator[str]:
    option = model.opt
    for field, wanted in (("integrator", EULER), ("solver", NEWTON), ("cone", PYRAMIDAL)):
        if int(getattr(option, field)) != wanted:
            yield f"its {field} must be {dict(integrator='Euler', solver='Newton', cone='pyramidal')[field]}"
    if int(option.disableflags) & ~HARMLESS != EULERDAMP or int(option.enableflags):
        yield "its flags must be the usual ones, but for eulerdamp, which must be off"
    if float(option.density) or float(option.viscosity):
        yield "its medium must be a vacuum"
    if np.asarray(option.gravity)[:2].any():
        yield "gravity must point along z"


def _geoms(model: Model) -> Iterator[str]:
    found, floors = list(pairs(model)), set()
    for a, b in found:
        fixed = [geom for geom in (a, b) if model.geom_bodyid[geom] == 0]
        floors.update(fixed)
        if not fixed:
            yield f"{name(model, 'geom', a)} may touch {name(model, 'geom', b)}"
        if len(floors) > 1:
            yield f"{' and '.join(name(model, 'geom', x) for x in sorted(floors))} are two floors"
        moving = a if b in fixed else b
        if model.geom_type[moving] != SPHERE:
            yield f"{name(model, 'geom', moving)} may touch {name(model, 'geom', fixed[0])} and is not a sphere"
    if not found:
        yield "nothing of it can touch a floor"
    floor, spheres = floor_and_spheres(model)
    upright = np.allclose(_values(model, "geom_quat")[floor, 1:3], 0.0, atol=1e-9)
    if model.geom_type[floor] != PLANE or _values(model, "geom_pos")[floor, 2] or not upright:
        yield f"{name(model, 'geom', floor)} is not the plane z = 0"
    for index in range(model.nnumeric):
        called, most = name(model, "numeric", index), _values(model, "numeric_data")[index]
        if called == "numeric 'max_contact_points'" and -1 < most < len(spheres):
            yield f"{called} is less than its {len(spheres)} spheres"


def _softness(model: Model) -> Iterator[str]:
    """One friction, solref and solimp for all contacts, and one for all limits: numbers then, instead of arrays."""
    floor, spheres = floor_and_spheres(model)
    first = meeting(model, floor, spheres[0])
    for geom in spheres:
        its, called = meeting(model, floor, geom), name(model, "geom", geom)
        if its.margin or _values(model, "geom_gap")[[floor, geom]].any():
            yield f"{called} or the floor has a margin or a gap"
        if its.condim != 3:
            yield f"{called} meets the floor with a condim that is not 3"
        for field in ("friction", "solref", "solimp"):
            if not np.allclose(getattr(its, field), getattr(first, field)):
                yield f"{called} meets the floor with another {field} than {name(model, 'geom', spheres[0])}"
    limited = np.flatnonzero(np.asarray(model.jnt_limited)).tolist()
    solref, solimp = _values(model, "jnt_solref"), _values(model, "jnt_solimp")
    for joint in limited:
        for field, values in (("solref", solref), ("solimp", solimp)):
            if not np.allclose(values[joint], values[limited[0]]):
                yield f"{name(model, 'joint', joint)} has another {field} than {name(model, 'joint', limited[0])}"
    settings = [(name(model, "geom", spheres[0]), first.solref, first.solimp)]
    settings += [(name(model, "joint", joint), solref[joint], solimp[joint]) for joint in limited[:1]]
    for called, reference, impedance in settings:
        if (reference <= 0).any():
            yield f"{called} has a solref that is not a time constant and a damping ratio"
        if impedance[4] != 2:
            yield f"{called} has a solimp whose power is not 2"
