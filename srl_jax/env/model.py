"""A robot's model: where its MJCF lies, how it is loaded, and what it must have.

This is the one module that imports MJX; others write ``from srl_jax.env.model import mjx``.
"""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path

import jax
import mujoco
import numpy as np

from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.env.interface import CONTROL_HZ, SUBSTEPS

# MJX announces on stdout, where results go, that its optional Warp backend is missing.
with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

__all__ = [
    "check",
    "feet",
    "forward",
    "load_model",
    "load_spec",
    "mjx",
    "put_model",
    "stance",
    "step",
    "xml_path",
    "xml_text",
]

LINKS = (0.004, 9.0)  # kg of a link: `damage.PRESENT` tells one, a shortened one too, from the ghost of another


def xml_path(anatomy: Anatomy = PHANTOMX) -> Path:
    """Path of a robot's MJCF: where its anatomy says, or in ``xml/`` of the checkout or of the installed wheel.

    Raises:
        ValueError: the file is in none of these places.
    """
    package = Path(__file__).resolve().parents[1]
    places = dict.fromkeys(folder / anatomy.mjcf for folder in (package.parent / "xml", package / "xml"))
    for path in places:
        if path.is_file():
            return path
    raise ValueError(f"robot {anatomy.name!r} has no MJCF: there is no {' and no '.join(map(str, places))}.")


def xml_text(anatomy: Anatomy = PHANTOMX) -> str:
    """The healthy robot's MJCF."""
    return xml_path(anatomy).read_text()


def load_spec(anatomy: Anatomy = PHANTOMX) -> mujoco.MjSpec:
    """A fresh, editable specification of the healthy robot."""
    return mujoco.MjSpec.from_file(str(xml_path(anatomy)))


def load_model(anatomy: Anatomy = PHANTOMX) -> mujoco.MjModel:
    """A fresh C MuJoCo model of the healthy robot with J joints: nq J + 7, nv J + 6, nu J, bodies torso + J links.

    Raises:
        ValueError: the MJCF is not as the anatomy says; one sentence names the first part that is missing or otherwise.
    """
    path = xml_path(anatomy)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise ValueError(f"{path} is no MJCF: {' '.join(str(error).split())}.") from error
    check(model, anatomy)
    return model


def check(model: mujoco.MjModel, anatomy: Anatomy) -> None:
    """Raises ValueError with the first thing in a model that is not as its anatomy says.

    Damage, observations and actions find their parts by place, so all of them stand in the order of the anatomy: body
    ``torso`` first, on a free joint; then for every joint, and in that order, a body, a hinge and an actuator of its
    name. Every leg has a sphere ``foot_<leg>`` on its last link, and only spheres of links touch, since a lost one is
    told by its radius not to. There is a keyframe ``stance``, a camera ``track`` and a light for the videos.
    """
    for reason in _lacks(model, anatomy):
        raise ValueError(f"{anatomy.mjcf} is not robot {anatomy.name!r}: {reason}.")


def _lacks(model: mujoco.MjModel, anatomy: Anatomy) -> Iterator[str]:
    links, free, hinge = list(anatomy.joints), mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_HINGE
    for kind, count, wanted in (
        ("body", model.nbody, ["world", "torso", *links]),
        ("joint", model.njnt, [None, *links]),
        ("actuator", model.nu, links),
    ):
        names = [getattr(model, kind)(index).name for index in range(count)]
        for index, name in enumerate(wanted):
            found = names[index] if index < count else ""
            if name not in (None, found):
                yield f"its {kind} {index} must be {name!r}" + f", not {found!r}" * bool(found)
        if count > len(wanted):
            yield f"it has the {kind} {names[len(wanted)]!r} too many"
    if model.jnt_type[0] != free or any(model.jnt_type[1:] != hinge):
        yield "its first joint must be free and all others hinges"
    if list(model.actuator_trnid[:, 0]) != list(range(1, model.njnt)):
        yield "every actuator must drive the joint of its name"
    yield from _lacks_links(model, anatomy)
    if abs(model.opt.timestep * CONTROL_HZ * SUBSTEPS - 1.0) > 1e-6:
        yield f"its timestep is {model.opt.timestep:g} s and must be {1.0 / (CONTROL_HZ * SUBSTEPS):.16g}"
    yield from _lacks_named(model, anatomy)


def _lacks_links(model: mujoco.MjModel, anatomy: Anatomy) -> Iterator[str]:
    links = anatomy.joints
    for index, name in enumerate(links):
        parent = "torso" if name.startswith(f"{anatomy.segments[0]}_") else links[index - 1]
        if model.body(model.body_parentid[index + 2]).name != parent:
            yield f"its body {name!r} must hang on {parent!r}"
        if model.jnt_bodyid[index + 1] != index + 2:
            yield f"its joint {name!r} must move the body of its name"
    for name, mass in zip(links, model.body_mass[2:], strict=True):
        if not LINKS[0] <= mass <= LINKS[1]:
            yield f"its link {name!r} weighs {mass:g} kg; from {LINKS[0]:g} to {LINKS[1]:g} are accepted"
    for geom in np.flatnonzero((model.geom_bodyid > 1) & (model.geom_contype | model.geom_conaffinity > 0)):
        if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_SPHERE or not model.geom_contype[geom]:
            body = model.body(model.geom_bodyid[geom]).name
            yield f"its link {body!r} may touch by what is no sphere with a contype, and no damage takes that off"


def _lacks_named(model: mujoco.MjModel, anatomy: Anatomy) -> Iterator[str]:
    for kind, names in (
        ("GEOM", [f"foot_{leg}" for leg in anatomy.legs]),
        ("KEY", ["stance"]),
        ("CAMERA", ["track"]),
    ):
        for name in names:
            if mujoco.mj_name2id(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), name) < 0:
                yield f"it has no {kind.lower()} {name!r}"
    if not model.nlight:
        yield "it has no light"
    for leg in anatomy.legs:
        foot = model.geom(f"foot_{leg}")
        if foot.type[0] != mujoco.mjtGeom.mjGEOM_SPHERE or model.body(foot.bodyid[0]).name != anatomy.last_link(leg):
            yield f"its geom 'foot_{leg}' must be a sphere of the body {anatomy.last_link(leg)!r}"


def put_model(model: mujoco.MjModel) -> mjx.Model:
    """The MJX counterpart of ``model``, on the default device.

    MJX counts line-search steps otherwise than C MuJoCo: 4 gave bitwise what 10 and 20 gave, at 1.2
    and 1.5 times their speed (64 rows of random targets, 2 s), where C needs 10 to give the same.
    """
    put = mjx.put_model(model)
    return put.replace(opt=put.opt.replace(ls_iterations=min(model.opt.ls_iterations, 4)))


def stance(model: mujoco.MjModel) -> np.ndarray:
    """Standing pose of the ``stance`` keyframe: f[nq], torso position (m), quaternion, joint angles (rad)."""
    return model.key("stance").qpos.copy()


def feet(model: mujoco.MjModel, anatomy: Anatomy = PHANTOMX) -> np.ndarray:
    """Ids of the foot spheres in the order of legs: i[L]."""
    return np.array([model.geom(f"foot_{leg}").id for leg in anatomy.legs])


def step(model: mjx.Model, data: mjx.Data) -> mjx.Data:
    """`mjx.step`: one physics step of ``model.opt.timestep`` seconds."""
    with _for_physics():
        return mjx.step(model, data)


def forward(model: mjx.Model, data: mjx.Data) -> mjx.Data:
    """`mjx.forward`: positions, contacts and forces of the present state."""
    with _for_physics():
        return mjx.forward(model, data)


@contextlib.contextmanager
def _for_physics() -> Iterator[None]:
    """How MJX is traced: it relies on NumPy's rank promotion, which our tests forbid elsewhere.

    Accelerators multiply f32 at 10 bits of mantissa unless told otherwise, and constraints do not bear that.
    """
    with jax.numpy_rank_promotion("allow"), jax.default_matmul_precision("highest"):
        yield
