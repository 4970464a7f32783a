"""Damage as values: the model leaves that differ between a healthy and a damaged robot.

A damage has a name (`damage_names`) and becomes a `Damage` of arrays, which may be batched and may change in the
middle of a rollout without recompiling. A removed link stays in the model as a weightless ghost that touches and
moves nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.damage_names import Loss, parse
from srl_jax.env.model import load_model, load_spec, mjx, stance

Array = jax.Array | np.ndarray

GHOST = 1e-4  # share of mass and inertia a removed link keeps: MuJoCo wants moving bodies to have some
PRESENT = 1e-3  # kg: of the PhantomX the lightest link weighs 25 g, the heaviest ghost 9 mg; see `model.LINKS`
NEVER_TOUCHES = -10.0  # radius (m) of a lost foot: its surface is 10 m above its centre in any attitude

# A locked joint stays a degree of freedom, made heavy so that nothing the robot does can accelerate it, and
# held by a critically damped spring so that it neither drifts nor keeps the speed it had when it locked. The
# spring is slow enough (10 rad/s) to carry a joint that locks in motion to its angle without throwing the
# robot.
LOCK_ARMATURE = 1e3  # kg m^2
LOCK_RATE = 10.0  # rad/s


class Damage(NamedTuple):
    """Every `mjx.Model` leaf that some damage changes, named as there; a leading axis batches damages.

    Of a robot with J joints: J + 2 bodies (world, torso, links), J + 6 degrees of freedom, J + 1 joints (root first).
    """

    body_mass: Array  # f32[J + 2] kg
    body_inertia: Array  # f32[J + 2, 3] kg m^2
    body_subtreemass: Array  # f32[J + 2] kg
    body_invweight0: Array  # f32[J + 2, 2]
    dof_invweight0: Array  # f32[J + 6]
    dof_armature: Array  # f32[J + 6] kg m^2
    dof_damping: Array  # f32[J + 6] N m s/rad
    jnt_stiffness: Array  # f32[J + 1] N m/rad
    qpos_spring: Array  # f32[J + 7] rad (m and quaternion for the root)
    geom_size: Array  # f32[ngeom, 3] m
    geom_pos: Array  # f32[ngeom, 3] m, in the link's frame
    actuator_gainprm: Array  # f32[J, 10]
    actuator_biasprm: Array  # f32[J, 10]
    actuator_forcerange: Array  # f32[J, 2] N m


def build(name: str, anatomy: Anatomy = PHANTOMX) -> Damage:
    """The damage called ``name`` as NumPy arrays.

    Args:
        name: of the damage.
        anatomy: of the robot, here and below.

    Raises:
        ValueError: for a bad name, as `damage_names.canonical`.
    """
    model = damaged_model(name, anatomy)
    return Damage(*(np.array(getattr(model, field), np.float32) for field in Damage._fields))


def stack(names: Sequence[str], anatomy: Anatomy = PHANTOMX) -> Damage:
    """The damages called ``names``, stacked on a leading axis, ready for ``vmap``.

    Raises:
        ValueError: for a bad name, as `damage_names.canonical`, or for no name at all.
    """
    if not names:
        raise ValueError("names is empty; at least one damage is needed.")
    return Damage(*(np.stack(leaves) for leaves in zip(*(build(name, anatomy) for name in names), strict=True)))


def apply(model: mjx.Model, damage: Damage) -> mjx.Model:
    """``model`` with the leaves of one (unbatched) ``damage``; works under ``vmap``."""
    return model.replace(**{field: jnp.asarray(leaf) for field, leaf in damage._asdict().items()})


def present(damage: Damage) -> Array:
    """Which joints have their link, bool[J]: a removed one has left a ghost, and its encoder is silent."""
    return damage.body_mass[2:] > PRESENT  # bodies 0 and 1: world and torso


def damaged_model(name: str, anatomy: Anatomy = PHANTOMX) -> mujoco.MjModel:
    """The C MuJoCo model with the same edits as `build`; removed links are also made invisible.

    Raises:
        ValueError: for a bad name, as `damage_names.canonical`.
    """
    model, losses = load_model(anatomy), parse(name, anatomy)
    for loss in losses:
        for joint in loss.joints:
            _weaken_servo(model, joint, {"weak": loss.amount, "short": 1.0}.get(loss.kind, 0.0))
            if loss.kind == "removed":
                _remove_link(model, joint)
            elif loss.kind == "locked":
                _lock_joint(model, joint, loss.amount)
            elif loss.kind == "short":
                _shorten_link(model, joint, loss.amount)
    _derive_constants(model, losses)
    return model


def recompiled(name: str, anatomy: Anatomy = PHANTOMX) -> mujoco.MjModel:
    """The robot that truly lacks its lost parts, compiled anew: the reference the edits are tested against.

    Removed links are deleted with all that hangs on them, a limp joint loses its actuator, a locked one is
    welded at its angle. The keyframe ``stance`` keeps the surviving joints.

    Raises:
        ValueError: for a bad name, as `damage_names.canonical`.
    """
    healthy, spec = load_model(anatomy), load_spec(anatomy)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO  # but for what is cut
    spec.delete(spec.key("stance"))
    gone = set()
    for loss in parse(name, anatomy):
        for joint in loss.joints:
            if loss.kind == "weak":
                _slacken_servo(spec.actuator(joint), loss.amount)
            elif loss.kind == "short":
                _cut_link(spec.body(joint), healthy, loss.amount)
            else:
                spec.delete(spec.actuator(joint))
        if loss.kind == "removed":
            spec.delete(spec.body(loss.joints[0]))
        elif loss.kind == "locked":
            _weld_joint(spec, healthy, loss.joints[0], loss.amount)
        if loss.kind in ("removed", "locked"):
            gone.update(loss.joints)
    angle = {joint: _stance_angle(healthy, joint) for joint in anatomy.joints}
    root = stance(healthy)[:7]
    key = spec.add_key(name="stance", qpos=[*root, *(angle[joint] for joint in anatomy.joints if joint not in gone)])
    key.ctrl = [angle[actuator.name] for actuator in spec.actuators]
    return spec.compile()


def _stance_angle(model: mujoco.MjModel, joint: str) -> float:
    return float(stance(model)[model.joint(joint).qposadr[0]])


def _remove_link(model: mujoco.MjModel, joint: str) -> None:
    """Leave a ghost of the link behind ``joint``: hardly any mass, no contact, not drawn."""
    body = model.body(joint).id
    model.body_mass[body] *= GHOST
    model.body_inertia[body] *= GHOST
    geoms = model.geom_bodyid == body
    model.geom_size[geoms & (model.geom_contype > 0), 0] = NEVER_TOUCHES
    model.geom_matid[geoms] = -1  # a material's colour would win over the geom's own
    model.geom_rgba[geoms] = 0


def _weaken_servo(model: mujoco.MjModel, joint: str, share: float) -> None:
    """Leave a servo this share of its torque; a limp one has none, and need not keep within any line."""
    actuator = model.actuator(joint).id
    model.actuator_gainprm[actuator] *= share
    model.actuator_biasprm[actuator] *= share
    model.actuator_forcerange[actuator] *= share or 1.0


def _shorten_link(model: mujoco.MjModel, joint: str, share: float) -> None:
    """Bring the foot nearer to ``joint``, and take the mass of what has broken off; the centre of mass stays."""
    body = model.body(joint).id
    model.body_mass[body] *= share
    model.body_inertia[body] *= share**3
    model.geom_pos[model.geom_bodyid == body] *= share


def _lock_joint(model: mujoco.MjModel, joint: str, degrees: float) -> None:
    """Make ``joint`` heavy and hold it, so far from its stance angle, by a stiff, critically damped spring."""
    dof = model.joint(joint).dofadr[0]
    model.dof_armature[dof] = LOCK_ARMATURE
    model.dof_damping[dof] = 2 * LOCK_ARMATURE * LOCK_RATE
    model.jnt_stiffness[model.joint(joint).id] = LOCK_ARMATURE * LOCK_RATE**2
    model.qpos_spring[model.joint(joint).qposadr[0]] = _stance_angle(model, joint) + np.radians(degrees)


def _derive_constants(model: mujoco.MjModel, losses: Sequence[Loss]) -> None:
    """Bring what MuJoCo derives from masses and inertias (inverse weights, subtree masses) up to date.

    It derives them with every joint at 0, where a locked joint will never be: its link is turned meanwhile.
    The joint's armature would swamp the mean inertia, which scales the solver's tolerances: that one is kept.
    """
    quats, meaninertia = model.body_quat.copy(), model.stat.meaninertia
    for loss in losses:
        if loss.kind == "locked":
            model.body(loss.joints[0]).quat = _locked_quat(model, loss.joints[0], loss.amount)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.body_quat[:] = quats
    model.stat.meaninertia = meaninertia


def _locked_quat(model: mujoco.MjModel, joint: str, degrees: float) -> np.ndarray:
    """Orientation in its parent, so far from the stance angle, of the link that ``joint`` moves: f[4]."""
    turn, quat = np.zeros(4), np.zeros(4)
    angle = _stance_angle(model, joint) + np.radians(degrees)
    mujoco.mju_axisAngle2Quat(turn, model.joint(joint).axis, angle)
    mujoco.mju_mulQuat(quat, model.body(joint).quat, turn)
    return quat


def _weld_joint(spec: mujoco.MjSpec, model: mujoco.MjModel, joint: str, degrees: float) -> None:
    """Delete ``joint`` from ``spec``, leaving its link so far from the stance angle."""
    body = spec.body(joint)
    body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    body.quat = _locked_quat(model, joint, degrees)
    spec.delete(spec.joint(joint))


def _slacken_servo(servo: mujoco.MjsActuator, share: float) -> None:
    servo.gainprm, servo.biasprm = servo.gainprm * share, servo.biasprm * share
    servo.forcerange = servo.forcerange * share


def _cut_link(body: mujoco.MjsBody, healthy: mujoco.MjModel, share: float) -> None:
    own = healthy.body(body.name)
    body.explicitinertial, body.mass, body.inertia = True, own.mass[0] * share, own.inertia * share**3
    body.ipos, body.iquat = own.ipos, own.iquat
    for geom in body.geoms:
        if geom.contype:
            geom.pos = geom.pos * share
