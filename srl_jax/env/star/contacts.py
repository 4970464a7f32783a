"""Which geoms meet, and how constraints give way: MuJoCo's rules, as `mjx.step` follows them."""

from collections.abc import Iterator
from itertools import combinations
from typing import Any, NamedTuple

import mujoco
import numpy as np

Model = Any  # `mjx.Model` or `mujoco.MjModel`: their fields have the same names
MINVAL = mujoco.mjMINVAL


class Meeting(NamedTuple):
    """What two geoms that touch agree on."""

    friction: float  # of sliding
    solref: np.ndarray  # f[2]
    solimp: np.ndarray  # f[5]
    condim: int
    margin: float  # m


class Softness(NamedTuple):
    """How constraint rows give way: solref and solimp as numbers of an equation."""

    stiffness: float  # 1/s^2
    damping: float  # 1/s
    least: float
    most: float
    width: float  # m or rad
    middle: float


def pairs(model: Model) -> Iterator[tuple[int, int]]:
    """Pairs of geoms (a < b) that are tried for contact; every moving body must have a joint of its own."""
    on, to, body, parent = model.geom_contype, model.geom_conaffinity, model.geom_bodyid, model.body_parentid
    excluded = set(np.asarray(model.exclude_signature).tolist())
    for a, b in combinations(np.flatnonzero(np.asarray(on | to)).tolist(), 2):
        inner, outer = sorted((int(body[a]), int(body[b])))
        related = inner == outer or (inner > 0 and parent[outer] == inner)
        if related or (inner << 16) + outer in excluded:
            continue
        if on[a] & to[b] or on[b] & to[a]:
            yield a, b


def floor_and_spheres(model: Model) -> tuple[int, list[int]]:
    """The one fixed geom that others can touch, and the others, of a model that `refusals.check` lets pass."""
    found = sorted(geom for pair in pairs(model) for geom in pair)
    fixed = [geom for geom in found if model.geom_bodyid[geom] == 0]
    return fixed[0], [geom for geom in found if model.geom_bodyid[geom] != 0]


def meeting(model: Model, a: int, b: int) -> Meeting:
    """How two geoms give way to each other.

    The geom of higher priority decides; of equal ones the larger friction and condim hold, and solref and solimp are
    mixed by weight.
    """
    of = lambda field, geom: np.asarray(getattr(model, f"geom_{field}"), np.float64)[geom]  # noqa: E731
    margin = float(of("margin", a) + of("margin", b))
    first, second = model.geom_priority[a], model.geom_priority[b]
    if first != second:
        chief = a if first > second else b
        friction, condim = of("friction", chief)[0], model.geom_condim[chief]
        return Meeting(float(friction), of("solref", chief), of("solimp", chief), int(condim), margin)
    share = _share(float(of("solmix", a)), float(of("solmix", b)))
    mixed = lambda field: share * of(field, a) + (1 - share) * of(field, b)  # noqa: E731
    standard = of("solref", a)[0] > 0 and of("solref", b)[0] > 0
    return Meeting(
        friction=float(max(of("friction", a)[0], of("friction", b)[0])),
        solref=mixed("solref") if standard else np.minimum(of("solref", a), of("solref", b)),
        solimp=mixed("solimp"),
        condim=int(max(model.geom_condim[a], model.geom_condim[b])),
        margin=margin,
    )


def _share(first: float, second: float) -> float:
    """The first geom's part in the mixture."""
    if first < MINVAL or second < MINVAL:
        return 0.5 if max(first, second) < MINVAL else float(first >= MINVAL)
    return first / (first + second)


def softness(solref: Any, solimp: Any, timestep: float) -> Softness:
    """MuJoCo's reading of solref (time constant, damping ratio) and solimp, within the bounds that it keeps them to."""
    timeconst, ratio = max(float(solref[0]), 2 * timestep), float(solref[1])
    least, most, middle = (float(np.clip(float(solimp[i]), mujoco.mjMINIMP, mujoco.mjMAXIMP)) for i in (0, 1, 3))
    return Softness(
        stiffness=1 / (most * timeconst * ratio) ** 2,
        damping=2 / (most * timeconst),
        least=least,
        most=most,
        width=max(float(solimp[2]), MINVAL),
        middle=middle,
    )
