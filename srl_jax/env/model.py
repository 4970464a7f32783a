"""The PhantomX model: where its MJCF lies and how it is loaded.

This is the one module that imports MJX; others write ``from srl_jax.env.model import mjx``.
"""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path

import jax
import mujoco
import numpy as np

from srl_jax.env.anatomy import LEGS

# MJX announces on stdout, where results go, that its optional Warp backend is missing.
with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

__all__ = [
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


def xml_path() -> Path:
    """Path of ``phantomx.xml``, in the checkout or in the installed wheel.

    Raises:
        FileNotFoundError: if the file is in neither place.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package.parent / "xml", package / "xml"):
        if (path := folder / "phantomx.xml").is_file():
            return path
    raise FileNotFoundError(f"phantomx.xml is neither in {package.parent / 'xml'} nor in {package / 'xml'}.")


def xml_text() -> str:
    """The healthy robot's MJCF."""
    return xml_path().read_text()


def load_spec() -> mujoco.MjSpec:
    """A fresh, editable specification of the healthy robot."""
    return mujoco.MjSpec.from_file(str(xml_path()))


def load_model() -> mujoco.MjModel:
    """A fresh C MuJoCo model of the healthy robot: nq 25, nv 24, nu 18, bodies torso + 18 links."""
    return mujoco.MjModel.from_xml_path(str(xml_path()))


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


def feet(model: mujoco.MjModel) -> np.ndarray:
    """Ids of the six foot spheres in ``LEGS`` order: i[6]."""
    return np.array([model.geom(f"foot_{leg}").id for leg in LEGS])


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
