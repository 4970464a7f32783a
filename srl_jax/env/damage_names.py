"""The language of damage: names such as ``tibia_rm``, ``leg_rm+leg_lf`` or ``tibia_rf:limp+leg_lm``.

Parts are joined with ``+``, each a joint (``removed``, ``limp`` or ``locked``) or a leg (``removed`` or ``limp``),
``removed`` where no kind is given; ``healthy`` has none.
"""

from itertools import combinations
from typing import NamedTuple

from srl_jax.env.model import LEGS, SEGMENTS

HEALTHY = "healthy"
JOINT_KINDS = ("removed", "limp", "locked")
LEG_KINDS = ("removed", "limp")


class Loss(NamedTuple):
    """One part of a damage name."""

    segment: str  # coxa, femur, tibia, or leg
    leg: str
    kind: str  # removed, limp, locked

    @property
    def name(self) -> str:
        part = f"{self.segment}_{self.leg}"
        return part if self.kind == "removed" else f"{part}:{self.kind}"

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints this loss disables, from the hip outwards; a removed link takes what hangs on it."""
        first = 0 if self.segment == "leg" else SEGMENTS.index(self.segment)
        last = len(SEGMENTS) if self.segment == "leg" or self.kind == "removed" else first + 1
        return tuple(f"{segment}_{self.leg}" for segment in SEGMENTS[first:last])


def canonical(name: str) -> str:
    """The one spelling of a damage: parts in leg and segment order, ``removed`` left out.

    Raises:
        ValueError: for an unknown part or kind, or where two parts concern the same joint.
    """
    return "+".join(loss.name for loss in parse(name)) or HEALTHY


def catalogue() -> tuple[str, ...]:
    """Healthy, 18 joints x 3 kinds, 6 legs x 2 kinds, and 15 pairs of removed legs: 82 names."""
    joints = [Loss(segment, leg, kind).name for leg in LEGS for segment in SEGMENTS for kind in JOINT_KINDS]
    legs = [Loss("leg", leg, kind).name for leg in LEGS for kind in LEG_KINDS]
    return (HEALTHY, *joints, *legs, *losses21()[len(LEGS) :])


def losses21() -> tuple[str, ...]:
    """The 6 + 15 losses of one or two legs, the set Mailer (2021) and HexaHeal report on."""
    return tuple("+".join(f"leg_{leg}" for leg in lost) for n in (1, 2) for lost in combinations(LEGS, n))


def task_set(task: str) -> tuple[str, ...]:
    """The paper's six damages for a task: a lost tibia for ``x``, a lost leg for ``xy`` and ``p2p``.

    Raises:
        ValueError: for an unknown task.
    """
    parts = {"x": "tibia", "xy": "leg", "p2p": "leg"}
    if task not in parts:
        raise ValueError(f"task is {task!r}; accepted are {', '.join(parts)}.")
    return tuple(f"{parts[task]}_{leg}" for leg in LEGS)


def parse_names(text: str, task: str) -> tuple[str, ...]:
    """Canonical names for a command line: ``task`` (`task_set`), ``all`` (`catalogue`), ``losses21``, or a comma list.

    Raises:
        ValueError: for a bad name, an unknown task, or a damage given twice.
    """
    if text.strip() == "task":
        return task_set(task)
    if text.strip() == "all":
        return catalogue()
    if text.strip() == "losses21":
        return losses21()
    names = tuple(canonical(name) for name in text.split(","))
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"damage {text!r} names {name!r} more than once; each damage is accepted once.")
    return names


def parse(name: str) -> tuple[Loss, ...]:
    """The losses in ``name``, in leg and segment order; none for ``healthy``.

    Raises:
        ValueError: as `canonical`.
    """
    if name.strip() == HEALTHY:
        return ()
    losses = sorted(
        (_parse_loss(part, name) for part in name.split("+")),
        key=lambda loss: (LEGS.index(loss.leg), ("leg", *SEGMENTS).index(loss.segment)),
    )
    owner: dict[str, Loss] = {}
    for loss in losses:
        for joint in loss.joints:
            if joint in owner:
                raise ValueError(
                    f"damage {name!r} names {joint} twice, by {owner[joint].name!r} and {loss.name!r}; "
                    "each joint is accepted in one part only."
                )
            owner[joint] = loss
    return tuple(losses)


def _parse_loss(part: str, name: str) -> Loss:
    place, colon, kind = part.strip().partition(":")
    segment, _, leg = place.partition("_")
    if segment not in ("leg", *SEGMENTS) or leg not in LEGS:
        raise ValueError(
            f"damage {name!r} has the unknown part {part!r}; accepted are {HEALTHY!r} alone, or leg_, coxa_, "
            f"femur_ or tibia_ followed by one of {', '.join(LEGS)}, joined with '+'."
        )
    kinds = LEG_KINDS if segment == "leg" else JOINT_KINDS
    if colon and kind not in kinds:
        raise ValueError(f"damage {name!r} has the unknown kind {kind!r} for {place}; accepted are {', '.join(kinds)}.")
    return Loss(segment, leg, kind or "removed")
