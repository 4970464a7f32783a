"""Robots as descriptions: what the parts of one are called, where its MJCF lies, and how its scripted gait steps.

Two ship, the PhantomX and a quadruped; `register` makes another known. Imports no jax, so that damage can be named
before devices are set up.
"""

import math
from dataclasses import dataclass
from functools import cache
from importlib import metadata

ENTRY_POINTS = "srl_jax.robots"  # each is a function without arguments that calls `register`
LEG = "leg"  # what a whole leg is called in the name of a damage
PLAIN = "letters and digits, beginning with a letter"


@dataclass(frozen=True)
class Anatomy:
    """A robot with L legs of three hinges each: a yaw at the hip, then two pitches that are positive upwards.

    Raises:
        ValueError: a field is not as said below; what its MJCF must have, `env.model.check` says.
    """

    name: str
    """What `--robot` calls it."""
    mjcf: str
    """Its file: the name of one in `xml/`, or a path."""
    legs: tuple[str, ...]
    """L names, in the order of the MJCF's bodies, joints and actuators, which are called `<segment>_<leg>`."""
    segments: tuple[str, str, str]
    """Names of a leg's links, from the hip outwards; a joint has the name of the link that it moves."""
    action_scale: tuple[float, float, float]
    """rad of each segment's joint about its stance at action 1."""
    mounts: tuple[float, ...]
    """degrees, L: where a leg points in its stance, counter-clockwise from ahead as seen from above."""
    phases: tuple[float, ...]
    """cycles, L: legs of one phase swing together in the scripted gait."""
    gait: str
    """The file of its tuned gait: the name of one in `srl_jax/env/`, or a path."""

    def __post_init__(self) -> None:
        for field, names in (("name", (self.name,)), ("legs", self.legs), ("segments", self.segments)):
            if not names or len(set(names)) < len(names) or not all(map(_plain, names)):
                raise ValueError(f"{field} is {names}: give names of {PLAIN}, none of them twice.")
        if LEG in self.segments:
            raise ValueError(f"segments is {self.segments}: {LEG!r} names a whole leg; give another name.")
        legs = len(self.legs)
        for field, count in (("segments", 3), ("action_scale", 3), ("mounts", legs), ("phases", legs)):
            if len(getattr(self, field)) != count:
                raise ValueError(f"{field} is {getattr(self, field)}: {count} are needed.")
        for field in ("action_scale", "mounts", "phases"):
            if not all(map(math.isfinite, getattr(self, field))):
                raise ValueError(f"{field} is {getattr(self, field)}: give finite numbers.")
        if min(self.action_scale) <= 0.0:
            raise ValueError(f"action_scale is {self.action_scale}: give angles above 0 (rad).")

    @property
    def joints(self) -> tuple[str, ...]:
        """Every joint, leg by leg from the hip outwards: J names, as actions and observations have them."""
        return tuple(f"{segment}_{leg}" for leg in self.legs for segment in self.segments)

    def last_link(self, leg: str) -> str:
        """The body that carries a leg's foot."""
        return f"{self.segments[-1]}_{leg}"

    @property
    def action_size(self) -> int:
        """J, of which an action has as many numbers."""
        return len(self.legs) * len(self.segments)


def _plain(name: str) -> bool:
    return name.isascii() and name.isalnum() and name[0].isalpha()


PHANTOMX = Anatomy(
    name="phantomx",
    mjcf="phantomx.xml",
    legs=("rf", "rm", "rr", "lf", "lm", "lr"),
    segments=("coxa", "femur", "tibia"),
    action_scale=(0.6, 0.7, 0.7),
    mounts=(-45.0, -90.0, -135.0, 45.0, 90.0, 135.0),
    phases=(0.0, 0.5, 0.0, 0.5, 0.0, 0.5),  # a tripod: {rf, rr, lm} and {rm, lf, lr} in antiphase
    gait="gait.json",
)
QUADRUPED = Anatomy(
    name="quadruped",
    mjcf="quadruped.xml",
    legs=("rf", "rr", "lf", "lr"),
    segments=("hip", "thigh", "shin"),
    action_scale=(0.6, 0.7, 0.7),
    mounts=(-45.0, -135.0, 45.0, 135.0),
    phases=(0.0, 0.5, 0.5, 0.0),  # a trot: the diagonals {rf, lr} and {rr, lf} in antiphase
    gait="quadruped_gait.json",
)
LEGS, SEGMENTS, JOINTS = PHANTOMX.legs, PHANTOMX.segments, PHANTOMX.joints

_known: dict[str, Anatomy] = {robot.name: robot for robot in (PHANTOMX, QUADRUPED)}


def register(anatomy: Anatomy) -> None:
    """Makes a robot known by its name, beside those that ship: ``--robot name``.

    An installed package does it by an entry point of the group ``srl_jax.robots``.

    Raises:
        ValueError: another robot has this name.
    """
    if _known.get(anatomy.name, anatomy) != anatomy:
        raise ValueError(f"name is {anatomy.name!r}: give one that is none of {', '.join(_known)}.")
    _known[anatomy.name] = anatomy


@cache
def _load_entry_points() -> None:
    for point in metadata.entry_points(group=ENTRY_POINTS):
        point.load()()


def named(name: str) -> Anatomy:
    """The robot of a name.

    Raises:
        ValueError: there is none.
    """
    _load_entry_points()
    if name not in _known:
        raise ValueError(f"robot is {name!r}: choose one of {', '.join(_known)}.")
    return _known[name]
