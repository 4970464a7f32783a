"""pi_B out of an atlas: for every lane the policy that is best under its damage, whoever it was trained for."""

from collections.abc import Sequence
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour as behaviours
from srl_jax.atlas import file, matrix
from srl_jax.atlas.file import Atlas
from srl_jax.config import Config
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.program.lanes import Lane
from srl_jax.types import Params

KINDS = ("atlas", "atlas-others")  # the best policy; the best that was not trained for this very damage
WALKS, STEPS = 4, 100  # by which policies are judged under a damage that the matrix lacks
STREAM = 11


def named(name: str) -> bool:
    """Whether a teacher's name asks for an atlas: ``atlas``, ``atlas-others``, or either with ``:FILE``."""
    return name.partition(":")[0] in KINDS


def load(name: str, config: Config) -> Atlas:
    """The atlas that a teacher's name asks for.

    Raises:
        ValueError: it cannot be read, was made for another task or observation, or the damage changes on the way.
    """
    atlas = file.load(name.partition(":")[2])
    for field, mine in (("task", config.task), ("observation", config.env.observation)):
        if atlas.about[field] != mine:
            raise ValueError(
                f"behaviour is {name!r}: its atlas was made with {field}={atlas.about[field]}, not {mine}."
            )
    if config.damage_schedule:
        raise ValueError(f"behaviour is {name!r}: it names a policy for one damage; leave damage_schedule out.")
    return atlas


def best(atlas: Atlas, damage: str, config: Config, *, others: bool) -> int:
    """The index of the policy that is worth most under a damage; `others`: of those not trained for it."""
    column = atlas.value[:, atlas.damages.index(damage)] if damage in atlas.damages else _judged(atlas, damage, config)
    own = np.array([others and name == damage for name in atlas.trained_for])
    return int(np.argmax(np.where(own, -np.inf, column)))


def _judged(atlas: Atlas, damage: str, config: Config) -> np.ndarray:
    """What every policy is worth under a damage that nobody foresaw: all of them walk in its simulation."""
    robot = hexapod.make(config.task, config.env, atlas.about["clock_hz"])
    actors = jax.tree.map(jnp.asarray, atlas.actors)
    key = jax.random.key(STREAM)
    walked = matrix.measure(robot, actors, damages.stack([damage]), key, config=atlas.network, walks=WALKS, steps=STEPS)
    return (walked.speed * (1.0 - walked.falls))[:, 0]


def parameters(name: str, config: Config):
    """What `teachers.Behaviour` is made of: the policy, its parameters for lanes, its clock and architecture.

    Raises:
        ValueError: as `load`.
    """
    atlas, others = load(name, config), name.startswith(KINDS[1])
    choose = cache(partial(best, atlas, config=config, others=others))

    def params(lanes: Sequence[Lane]) -> Params:
        index = np.array([choose(lane.damage) for lane in lanes])
        return jax.tree.map(lambda leaf: leaf[index], atlas.actors)

    apply = partial(behaviours.policy, config=atlas.network)
    return apply, params, float(atlas.about["clock_hz"]), atlas.network.architecture
