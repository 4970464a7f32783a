"""Policies that ship with the package, ready to walk: observation -> action by NumPy alone. Imports no jax.

    policy = srl_jax.pretrained.load("srl", task="p2p", damage="leg_rm")
    action = policy(observation)  # f32[18] of f32[51]; policy.about says what these are

`srl` and `ddpg` are one seed each of ``python -m srl_jax.run --task TASK --damage healthy,task --seeds 1``, by
``python -m srl_jax.export RUN --precision coarse --out srl_jax/pretrained/TASK.npz``; they see all of the simulation's
state. `atlas` are those of the atlas that ships: for the whole catalogue of damages, by what a real robot senses.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

from srl_jax import portable
from srl_jax.atlas import stored
from srl_jax.env import damage_names
from srl_jax.portable import Policy

FOLDER = Path(__file__).parent
ATLAS = "atlas"
MANY = 12  # names that a sentence bears


class Name(NamedTuple):
    """What one of the policies is asked for by."""

    name: str  # srl, ddpg or atlas
    task: str  # x or p2p
    damage: str  # canonical


def names() -> list[Name]:
    """All that ship."""
    return list(_shipped())


def load(name: str, *, task: str, damage: str) -> Policy:
    """One of the policies that ship.

    Args:
        name: srl, ddpg or atlas.
        task: x or p2p.
        damage: that it was trained for, such as leg_rm, in any spelling.

    Raises:
        ValueError: there is none of the name, for the task or for the damage.
    """
    wanted = Name(name, task, damage_names.canonical(damage))
    if wanted in _shipped():
        return _shipped()[wanted]
    for place, field in enumerate(Name._fields):
        there = list(dict.fromkeys(own[place] for own in names() if own[:place] == wanted[:place]))
        if wanted[place] not in there:
            whose = f"{' for '.join(wanted[:place])} has" if place else "there are"
            few = ", ".join(there) if len(there) <= MANY else f"{len(there)}, which srl_jax.pretrained.names() lists"
            raise ValueError(f"{field} is {wanted[place]!r}: {whose} {few}.")
    raise AssertionError(wanted)


@cache
def _shipped() -> dict[Name, Policy]:
    found: dict[Name, Policy] = {}
    for path in sorted(FOLDER.glob("*.npz")):
        for policy in portable.load(path):
            found[Name(policy.about["method"], policy.about["task"], policy.about["damage"])] = policy
    atlas = stored.read()
    own = stored.policies(atlas)
    return found | {Name(ATLAS, atlas.about["task"], damage): policy for damage, policy in own.items()}
