"""The language of damage: names such as ``tibia_rm``, ``leg_rm+leg_lf`` or ``tibia_rf:limp+femur_lm:weak=0.5``.

Parts are joined with ``+``, each a joint or a leg with what has become of it: ``removed`` (where no kind is given),
``limp``, ``locked`` at its stance angle or ``locked=20`` degrees from it (joints only), ``weak=0.5`` with this share of
its servo's torque, ``short=0.6`` with this share of its length (tibiae only); ``healthy`` has none. What lies beyond a
removed joint is removed as well, so a removed coxa is a removed leg, and is called so.
"""

import contextlib
from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

from srl_jax.env.anatomy import JOINTS, LEGS, SEGMENTS

HEALTHY = "healthy"
JOINT_KINDS = ("removed", "limp", "locked")
LEG_KINDS = ("removed", "limp")
LOCKS = 45.0  # degrees to either side of the stance that a joint can lock at


class Loss(NamedTuple):
    """One part of a damage name."""

    segment: str  # coxa, femur, tibia, or leg
    leg: str
    kind: str  # removed, limp, locked, weak, short
    amount: float = 0.0  # degrees of a lock, share of torque or length

    @property
    def name(self) -> str:
        part = f"{self.segment}_{self.leg}"
        return part if self.kind == "removed" else f"{part}:{self.kind}{f'={self.amount:g}' if self.amount else ''}"

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints this loss disables, from the hip outwards; a removed link takes what hangs on it."""
        first = 0 if self.segment == "leg" else SEGMENTS.index(self.segment)
        last = len(SEGMENTS) if self.segment == "leg" or self.kind == "removed" else first + 1
        return tuple(f"{segment}_{self.leg}" for segment in SEGMENTS[first:last])


def canonical(name: str) -> str:
    """The one spelling of a damaged robot: parts in leg and segment order, whole legs as such, ``removed`` left out.

    Raises:
        ValueError: for an unknown part or kind, or where two parts concern the same joint.
    """
    return "+".join(loss.name for loss in parse(name)) or HEALTHY


def catalogue() -> tuple[str, ...]:
    """Healthy, 18 joints x 3 kinds (a removed coxa being a removed leg), 6 limp legs, 15 pairs of removed legs: 76."""
    joints = [canonical(f"{joint}:{kind}") for joint in JOINTS for kind in JOINT_KINDS]
    return (HEALTHY, *joints, *(f"leg_{leg}:limp" for leg in LEGS), *losses21()[len(LEGS) :])


def losses21() -> tuple[str, ...]:
    """The 6 + 15 losses of one or two legs, the set Mailer (2021) and HexaHeal report on."""
    return lost(1) + lost(2)


def lost(count: int) -> tuple[str, ...]:
    """Every loss of so many whole legs."""
    return tuple("+".join(f"leg_{leg}" for leg in legs) for legs in combinations(LEGS, count))


def task_set(task: str) -> tuple[str, ...]:
    """The paper's six damages for a task: a lost tibia for ``x``, a lost leg for ``xy`` and ``p2p``.

    Raises:
        ValueError: for an unknown task.
    """
    parts = {"x": "tibia", "xy": "leg", "p2p": "leg"}
    if task not in parts:
        raise ValueError(f"task is {task!r}; accepted are {', '.join(parts)}.")
    return tuple(f"{parts[task]}_{leg}" for leg in LEGS)


def named_sets(task: str) -> dict[str, Callable[[], tuple[str, ...]]]:
    """Sets of damages that a command line may name."""
    return {
        HEALTHY: lambda: (HEALTHY,),
        "task": lambda: task_set(task),
        "all": catalogue,
        "losses21": losses21,
        "joints": lambda: tuple(canonical(f"{joint}:{kind}") for joint in JOINTS for kind in JOINT_KINDS),
        "limp": lambda: tuple(f"leg_{leg}:limp" for leg in LEGS),
        "triples": lambda: lost(3),
    }


def parse_names(text: str, task: str) -> tuple[str, ...]:
    """Canonical names for a command line: a comma list of names and of `named_sets`, or of sets joined by ``+``.

    What is in several of the sets is taken once.

    Raises:
        ValueError: for a bad name, an unknown task, or a damage given twice by name.
    """
    sets, names, united = named_sets(task), [], []
    for item in (item.strip() for item in text.split(",")):
        parts = [part.strip() for part in item.split("+")]
        if all(part in sets for part in parts):
            united += [name for part in parts for name in sets[part]()]
        else:
            names.append(canonical(item))
            united.append(names[-1])
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"damage {text!r} names {name!r} more than once; each damage is accepted once.")
    return tuple(dict.fromkeys(united))


def parse(name: str) -> tuple[Loss, ...]:
    """The losses in ``name``, in leg and segment order; none for ``healthy``.

    Raises:
        ValueError: as `canonical`.
    """
    if name.strip() == HEALTHY:
        return ()
    owner: dict[str, Loss] = {}
    for loss in (_parse_loss(part, name) for part in name.split("+")):
        for joint in loss.joints:
            if joint in owner:
                raise ValueError(
                    f"damage {name!r} names {joint} twice, by {owner[joint].name!r} and {loss.name!r}; "
                    "each joint is accepted in one part only."
                )
            owner[joint] = loss
    return tuple(loss for leg in LEGS for loss in _spell(leg, owner))


def _spell(leg: str, owner: dict[str, Loss]) -> Iterator[Loss]:
    """The fewest losses that do to a leg's joints what their owners do, from the hip outwards."""
    own = [owner.get(f"{segment}_{leg}") for segment in SEGMENTS]
    fates = {loss and (loss.kind, loss.amount) for loss in own}
    if own[0] and own[0].kind in (*LEG_KINDS, "weak") and len(fates) == 1:
        yield own[0]._replace(segment="leg")
        return
    for segment, loss in zip(SEGMENTS, own, strict=True):
        if loss:
            yield loss._replace(segment=segment)
        if loss and loss.kind == "removed":  # with all that hangs on it
            return


def _parse_loss(part: str, name: str) -> Loss:
    place, colon, kind = part.strip().partition(":")
    segment, _, leg = place.partition("_")
    if segment not in ("leg", *SEGMENTS) or leg not in LEGS:
        raise ValueError(
            f"damage {name!r} has the unknown part {part!r}; accepted are {HEALTHY!r} alone, or leg_, coxa_, "
            f"femur_ or tibia_ followed by one of {', '.join(LEGS)}, joined with '+'."
        )
    kind, equals, amount = kind.partition("=")
    kinds = [*(LEG_KINDS if segment == "leg" else JOINT_KINDS), "weak", *(["short"] if segment == "tibia" else [])]
    if colon and kind not in kinds:
        raise ValueError(
            f"damage {name!r} has the unknown kind {kind!r} for {place}; accepted are {', '.join(map(_shown, kinds))}."
        )
    return Loss(segment, leg, kind or "removed", _parse_amount(kind, amount if equals else None, part, name))


def _shown(kind: str) -> str:
    return f"{kind}=SHARE" if kind in ("weak", "short") else kind


def _parse_amount(kind: str, text: str | None, part: str, name: str) -> float:
    """What stands behind the equals sign of a part."""
    least, most = {"locked": (-LOCKS, LOCKS), "weak": (0.05, 0.95), "short": (0.3, 0.95)}.get(kind, (0.0, -1.0))
    if text is None and least <= 0.0:
        return 0.0
    with contextlib.suppress(ValueError):
        if least <= float(text or "") <= most:
            return float(text or "")
    wanted = f"a number from {least:g} to {most:g}" if least <= most else "no number"
    raise ValueError(f"damage {name!r} has the part {part.strip()!r}; {kind} takes {wanted} behind an equals sign.")
