"""Who of an atlas teaches a lane: the policy that is best under its damage, whoever it was trained for."""

import numpy as np

from srl_jax.atlas import file, recovery
from srl_jax.atlas.file import Atlas
from srl_jax.config import Config
from srl_jax.env.anatomy import PHANTOMX

KINDS = ("atlas", "atlas-others")  # the best policy; the best that was not trained for this very damage


def named(name: str) -> bool:
    """Whether a teacher's name asks for an atlas: ``atlas``, ``atlas-others``, or either with ``:FILE``."""
    return name.partition(":")[0] in KINDS


def load(name: str, config: Config) -> Atlas:
    """The atlas that a teacher's name asks for.

    Raises:
        ValueError: it cannot be read, was made for another robot, task or observation, or a lane has more than one
            damage.
    """
    if config.anatomy != PHANTOMX:
        raise ValueError(f"robot is {config.robot!r}: atlases are the {PHANTOMX.name}'s; choose another behaviour.")
    atlas = file.load(name.partition(":")[2])
    for field, mine in (("task", config.task), ("observation", config.env.observation)):
        if atlas.about[field] != mine:
            raise ValueError(
                f"behaviour is {name!r}: its atlas was made with {field}={atlas.about[field]}, not {mine}."
            )
    if config.env.history:
        raise ValueError(
            f"behaviour is {name!r}: its policies see no history; leave env.history={config.env.history} out."
        )
    for field in ("damage_schedule", "damage_mix"):
        if getattr(config, field):
            raise ValueError(f"behaviour is {name!r}: it names a policy for one damage; leave {field} out.")
    return atlas


def best(name: str, atlas: Atlas, damage: str) -> int:
    """The index of the policy that a teacher's name stands for under a damage."""
    others = name.partition(":")[0] == KINDS[1]
    own = np.array([others and trained == damage for trained in atlas.trained_for])
    return int(np.argmax(np.where(own, -np.inf, recovery.worth(atlas, damage))))
