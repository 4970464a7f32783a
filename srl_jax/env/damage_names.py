"""The language of damage: names such as ``tibia_rm``, ``leg_rm+leg_lf`` or ``tibia_rf:limp+femur_lm:weak=0.5``.

What legs and joints are called is the robot's (`env.anatomy`); examples here are the PhantomX's.

Parts are joined with ``+``, each a joint or a leg with what has become of it: ``removed`` (where no kind is given),
``limp``, ``locked`` at its stance angle or ``locked=20`` degrees from it (joints only), ``weak=0.5`` with this share of
its servo's torque, ``short=0.6`` with this share of its length (last links only); ``healthy`` has none. What lies
beyond a removed joint is removed as well, so a removed coxa is a removed leg, and is called so.
"""

import contextlib
from collections.abc import Callable, Iterator
from itertools import combinations
from typing import NamedTuple

from srl_jax.env.anatomy import LEG, PHANTOMX, SEGMENTS, Anatomy

HEALTHY = "healthy"
JOINT_KINDS = ("removed", "limp", "locked")
LEG_KINDS = ("removed", "limp")
LOCKS = 45.0  # degrees to either side of the stance that a joint can lock at


class Loss(NamedTuple):
    """One part of a damage name."""

    segment: str  # one of `segments`, or leg
    leg: str
    kind: str  # removed, limp, locked, weak, short
    amount: float = 0.0  # degrees of a lock, share of torque or length
    segments: tuple[str, ...] = SEGMENTS  # of its robot's legs, from the hip outwards

    @property
    def name(self) -> str:
        part = f"{self.segment}_{self.leg}"
        return part if self.kind == "removed" else f"{part}:{self.kind}{f'={self.amount:g}' if self.amount else ''}"

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints this loss disables, from the hip outwards; a removed link takes what hangs on it."""
        first = 0 if self.segment == LEG else self.segments.index(self.segment)
        last = len(self.segments) if self.segment == LEG or self.kind == "removed" else first + 1
        return tuple(f"{segment}_{self.leg}" for segment in self.segments[first:last])


def canonical(name: str, anatomy: Anatomy = PHANTOMX) -> str:
    """The one spelling of a damaged robot: parts in leg and segment order, whole legs as such, ``removed`` left out.

    Args:
        name: of the damage.
        anatomy: of the robot, here and below.

    Raises:
        ValueError: for an unknown part or kind, or where two parts concern the same joint.
    """
    return "+".join(loss.name for loss in parse(name, anatomy)) or HEALTHY


def catalogue(anatomy: Anatomy = PHANTOMX) -> tuple[str, ...]:
    """Healthy, every joint removed, limp and locked, every leg limp, every pair of legs removed.

    Of the PhantomX 76: 18 joints x 3 kinds (a removed coxa being a removed leg), 6 limp legs, 15 pairs.
    """
    return (HEALTHY, *_joints(anatomy), *_limp(anatomy), *lost(2, anatomy))


def losses21() -> tuple[str, ...]:
    """The 6 + 15 losses of one or two legs of the PhantomX, the set Mailer (2021) and HexaHeal report on."""
    return lost(1) + lost(2)


def losses(anatomy: Anatomy = PHANTOMX) -> tuple[str, ...]:
    """Every joint lost, with what hangs on it: of the PhantomX 18, six of them whole legs."""
    return tuple(canonical(joint, anatomy) for joint in anatomy.joints)


def lost(count: int, anatomy: Anatomy = PHANTOMX) -> tuple[str, ...]:
    """Every loss of so many whole legs."""
    return tuple("+".join(f"{LEG}_{leg}" for leg in legs) for legs in combinations(anatomy.legs, count))


def task_set(task: str, anatomy: Anatomy = PHANTOMX) -> tuple[str, ...]:
    """The paper's damages for a task, one a leg: a lost last link (tibia) for ``x``, a lost leg for ``xy`` and ``p2p``.

    Raises:
        ValueError: for an unknown task.
    """
    parts = {"x": anatomy.segments[-1], "xy": LEG, "p2p": LEG}
    if task not in parts:
        raise ValueError(f"task is {task!r}; accepted are {', '.join(parts)}.")
    return tuple(f"{parts[task]}_{leg}" for leg in anatomy.legs)


def named_sets(task: str, anatomy: Anatomy = PHANTOMX) -> dict[str, Callable[[], tuple[str, ...]]]:
    """Sets of damages that a command line may name; one or two lost legs are `losses21` where there are six."""
    one_or_two = lost(1, anatomy) + lost(2, anatomy)
    return {
        HEALTHY: lambda: (HEALTHY,),
        "task": lambda: task_set(task, anatomy),
        "all": lambda: catalogue(anatomy),
        "losses": lambda: losses(anatomy),
        f"losses{len(one_or_two)}": lambda: one_or_two,
        "joints": lambda: _joints(anatomy),
        "limp": lambda: _limp(anatomy),
        "triples": lambda: lost(3, anatomy),
    }


def _joints(anatomy: Anatomy) -> tuple[str, ...]:
    return tuple(canonical(f"{joint}:{kind}", anatomy) for joint in anatomy.joints for kind in JOINT_KINDS)


def _limp(anatomy: Anatomy) -> tuple[str, ...]:
    return tuple(f"{LEG}_{leg}:limp" for leg in anatomy.legs)


def parse_names(text: str, task: str, anatomy: Anatomy = PHANTOMX) -> tuple[str, ...]:
    """Canonical names for a command line: a comma list of names and of `named_sets`, or of sets joined by ``+``.

    What is in several of the sets is taken once.

    Raises:
        ValueError: for a bad name, an unknown task, or a damage given twice by name.
    """
    sets, names, united = named_sets(task, anatomy), [], []
    for item in (item.strip() for item in text.split(",")):
        parts = [part.strip() for part in item.split("+")]
        if all(part in sets for part in parts):
            united += [name for part in parts for name in sets[part]()]
        else:
            names.append(canonical(item, anatomy))
            united.append(names[-1])
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"damage {text!r} names {name!r} more than once; each damage is accepted once.")
    return tuple(dict.fromkeys(united))


def parse(name: str, anatomy: Anatomy = PHANTOMX) -> tuple[Loss, ...]:
    """The losses in ``name``, in leg and segment order; none for ``healthy``.

    Raises:
        ValueError: as `canonical`.
    """
    if name.strip() == HEALTHY:
        return ()
    owner: dict[str, Loss] = {}
    for loss in (_parse_loss(part, name, anatomy) for part in name.split("+")):
        for joint in loss.joints:
            if joint in owner:
                raise ValueError(
                    f"damage {name!r} names {joint} twice, by {owner[joint].name!r} and {loss.name!r}; "
                    "each joint is accepted in one part only."
                )
            owner[joint] = loss
    return tuple(loss for leg in anatomy.legs for loss in _spell(leg, owner, anatomy.segments))


def _spell(leg: str, owner: dict[str, Loss], segments: tuple[str, ...]) -> Iterator[Loss]:
    """The fewest losses that do to a leg's joints what their owners do, from the hip outwards."""
    own = [owner.get(f"{segment}_{leg}") for segment in segments]
    fates = {loss and (loss.kind, loss.amount) for loss in own}
    if own[0] and own[0].kind in (*LEG_KINDS, "weak") and len(fates) == 1:
        yield own[0]._replace(segment=LEG)
        return
    for segment, loss in zip(segments, own, strict=True):
        if loss:
            yield loss._replace(segment=segment)
        if loss and loss.kind == "removed":  # with all that hangs on it
            return


def _parse_loss(part: str, name: str, anatomy: Anatomy) -> Loss:
    place, colon, kind = part.strip().partition(":")
    segment, _, leg = place.partition("_")
    if segment not in (LEG, *anatomy.segments) or leg not in anatomy.legs:
        *first, last = (f"{own}_" for own in (LEG, *anatomy.segments))
        raise ValueError(
            f"damage {name!r} has the unknown part {part!r}; accepted are {HEALTHY!r} alone, or {', '.join(first)} "
            f"or {last} followed by one of {', '.join(anatomy.legs)}, joined with '+'."
        )
    kind, equals, amount = kind.partition("=")
    more = ["short"] if segment == anatomy.segments[-1] else []
    kinds = [*(LEG_KINDS if segment == LEG else JOINT_KINDS), "weak", *more]
    if colon and kind not in kinds:
        raise ValueError(
            f"damage {name!r} has the unknown kind {kind!r} for {place}; accepted are {', '.join(map(_shown, kinds))}."
        )
    share = _parse_amount(kind, amount if equals else None, part, name)
    return Loss(segment, leg, kind or "removed", share, anatomy.segments)


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
