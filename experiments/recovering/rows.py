"""What robots go through: damages, what their atlas is not to know of them, and worlds; a row of the table each."""

import zlib
from collections.abc import Callable, Sequence
from itertools import cycle, islice
from typing import NamedTuple

import numpy as np

from srl_jax.atlas.robots import World
from srl_jax.env.anatomy import LEGS, SEGMENTS
from srl_jax.env.damage_names import HEALTHY, canonical, catalogue, losses21, lost, parse

Random = np.random.Generator


class Row(NamedTuple):
    """One kind of hardship."""

    said: str
    damages: Sequence[str] | Callable[[Random], str]  # in turn, or drawn for every robot
    without: Callable[[str], Sequence[str]] = lambda damage: ()  # neither policies nor hypotheses of these
    world: Callable[[Random], World] = lambda random: World()


class Case(NamedTuple):
    """One robot's lot."""

    damage: str
    without: tuple[str, ...]
    world: World


def _legs(random: Random, count: int) -> list[str]:
    return [str(leg) for leg in random.choice(LEGS, count, replace=False)]


def _joint(random: Random, leg: str) -> str:
    return f"{random.choice(SEGMENTS)}_{leg}"


def _weak(random: Random) -> str:
    leg = _legs(random, 1)[0]
    place = f"leg_{leg}" if random.random() < 0.25 else _joint(random, leg)
    return f"{place}:weak={random.uniform(0.2, 0.8):.2f}"


def _lock(random: Random) -> str:
    return f"{_joint(random, _legs(random, 1)[0])}:locked={random.uniform(-40.0, 40.0):.0f}"


def _faults(random: Random) -> str:
    return "+".join(f"{_joint(random, leg)}:{random.choice(['limp', 'locked'])}" for leg in _legs(random, 2))


def _kinds(random: Random) -> str:
    """A lost leg or tibia, and a joint of another leg that is limp, locked or weak."""
    first, second = _legs(random, 2)
    fault = random.choice(["limp", "locked", f"weak={random.uniform(0.2, 0.5):.2f}"])
    return f"{random.choice(['leg', 'tibia'])}_{first}+{_joint(random, second)}:{fault}"


def _world(random: Random) -> World:
    """Friction, mass, servos, payload, slope and biases, drawn from the ranges that the covariance was fitted on."""
    return World(
        friction=random.uniform(0.4, 1.2),
        mass=random.uniform(0.8, 1.2),
        gain=random.uniform(0.7, 1.1),
        payload=random.uniform(0.0, 0.5),
        slope=random.uniform(-5.0, 5.0),
        bias=1.0,
        encoder=0.29,
    )


def _many_legs(damage: str) -> list[str]:
    """All of the catalogue that concern several legs."""
    return [name for name in catalogue() if len({loss.leg for loss in parse(name)}) > 1]


ROWS = {
    "foreseen": Row("one or two legs lost (21)", losses21()),
    "catalogue": Row("any damage of the atlas", catalogue()[1:]),
    "left-out": Row("one or two legs lost, left out of the atlas", losses21(), lambda damage: [damage]),
    "pairs": Row("two legs lost, atlas of damages to one leg", losses21()[len(LEGS) :], _many_legs),
    "triples": Row("three legs lost", lost(3)),
    "faults": Row("two joints limp or locked", _faults),
    "kinds": Row("a lost limb, and a joint limp, locked or weak", _kinds),
    "weak": Row("a joint or leg with .2 to .8 of its torque", _weak),
    "locks": Row("a joint locked at any angle", _lock),
    "short": Row("a tibia shortened to .6", [f"tibia_{leg}:short=0.6" for leg in LEGS]),
    "dynamics": Row("one or two legs lost, other dynamics", losses21(), world=_world),
    "delay": Row("one or two legs lost, 50 or 100 ms late", losses21(), world=lambda r: World(delay=1 + r.integers(2))),
    "lost": Row("one or two legs lost, 5 % of packets lost", losses21(), world=lambda random: World(lost=0.05)),
    "healthy": Row("nothing, in other dynamics", [HEALTHY], world=_world),
}


def cases(name: str, count: int, seed: int = 0) -> list[Case]:
    """The lots of so many robots; always the same ones of a seed."""
    row, random = ROWS[name], np.random.default_rng(zlib.crc32(name.encode()) + seed)
    draw = row.damages
    if callable(draw):
        names = [str(draw(random)) for _ in range(count)]
    else:
        names = list(islice(cycle(str(draw[i]) for i in random.permutation(len(draw))), count))
    return [Case(canonical(own), tuple(row.without(own)), row.world(random)) for own in names]
