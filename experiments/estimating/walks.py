"""Walks to learn from: robots in worlds of their own, damaged in mid-stride, under the policies that will walk them.

Until it could know, a robot walks as the healthy do; then by the best policy for its damage or by any other, since that
is what robots do that are still in doubt. Some have a damage that the atlas does not have: none of these, to it.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour
from srl_jax.agents.settings import DDPGConfig
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.fit import UNAWARE, WORLDS
from srl_jax.atlas.robots import CRobot, World
from srl_jax.env import damage_names
from srl_jax.env import senses as feeling
from srl_jax.env.anatomy import LEGS, SEGMENTS
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.senses import Senses
from srl_jax.types import Params

STEPS = 80  # control steps of a walk: four seconds
STRIKE = (5, 45)  # in which the damage comes
HELD = (10, 40)  # control steps for which a policy is kept
OWN = 0.5  # share of such segments that the best policy for the damage walks
ENCODER = 0.29  # degrees that the encoders of every second robot tell apart
KINDS = ("removed", "limp", "locked", "weak", "short")
FAULTS = (0.4, 0.4, 0.2)  # share of the robots with one, two and three faults among those of no damage of the atlas
FAR = 10.0  # degrees: a lock that is nearer to the stance is the atlas' own
ABREAST = 128  # robots that act at once


class Lot(NamedTuple):
    """What one robot goes through."""

    damage: str
    label: int  # index of the damage among the atlas' D; D: none of these
    strike: int  # control steps before it
    policy: np.ndarray  # i32[T] who walks
    phase: float  # of the gait's clock at the start
    world: World
    seed: int


class Walks(NamedTuple):
    """N robots, T control steps; the damage of each step is what it was when it was made."""

    action: np.ndarray  # f32[N, T, 18]
    felt: np.ndarray  # f32[N, T, 24] after it
    answering: np.ndarray  # bool[N, T, 18] after it
    label: np.ndarray  # i32[N, T] as of `Lot`


def unforeseen(names: Sequence[str], random: np.random.Generator) -> str:
    """A damage of one to three legs that is none of `names`."""
    while True:
        legs = random.choice(LEGS, 1 + random.choice(len(FAULTS), p=FAULTS), replace=False)
        name = damage_names.canonical("+".join(_fault(leg, str(random.choice(KINDS)), random) for leg in legs))
        if name not in names:
            return name


def _fault(leg: str, kind: str, random: np.random.Generator) -> str:
    place = "tibia" if kind == "short" else str(random.choice(SEGMENTS))
    locked = random.choice([-1.0, 1.0]) * random.uniform(FAR, damage_names.LOCKS)
    amount = {"locked": locked, "weak": random.uniform(0.1, 0.6), "short": random.uniform(0.4, 0.8)}.get(kind)
    return f"{place}_{leg}:{kind}" + ("" if amount is None else f"={amount:.2f}")


def lots(atlas: Atlas, seed: int, *, each: int, healthy: int, none: int) -> list[Lot]:
    """Robots of every damage but the healthy one, healthy ones, and some that have none of these.

    Args:
        atlas: whose damages and policies.
        seed: of everything that is drawn.
        each: robots of every damage.
        healthy: robots that stay healthy.
        none: robots whose damage the atlas does not have.
    """
    random = np.random.default_rng(seed)
    own = np.argmax(atlas.value, axis=0)
    found = []
    for label, name in enumerate(atlas.damages):
        count = healthy if name == damage_names.HEALTHY else each
        found += [_lot(atlas, name, label, int(own[label]), int(own[0]), random) for _ in range(count)]
    for _ in range(none):
        name, best = unforeseen(atlas.damages, random), int(random.integers(len(atlas.trained_for)))
        found.append(_lot(atlas, name, len(atlas.damages), best, int(own[0]), random))
    return found


def _lot(atlas: Atlas, name: str, label: int, best: int, before: int, random: np.random.Generator) -> Lot:
    strike = int(random.integers(*STRIKE))
    policy, step = np.full(STEPS, before, np.int32), strike + int(random.integers(UNAWARE + 1))
    while step < STEPS:
        until = step + int(random.integers(*HELD))
        policy[step:until] = best if random.random() < OWN else random.integers(len(atlas.trained_for))
        step = until
    drawn = {field: float(random.uniform(*limits)) for field, limits in WORLDS.items()}
    world = World(**drawn, encoder=float(random.choice([0.0, ENCODER])))  # pyright: ignore[reportArgumentType]
    return Lot(name, label, strike, policy, float(random.uniform()), world, int(random.integers(2**31)))


def walked(atlas: Atlas, found: Sequence[Lot]) -> Walks:
    """The walks of so many robots in C MuJoCo at 2 ms (`CRobot`), each in its own world."""
    blocks = [found[first : first + ABREAST] for first in range(0, len(found), ABREAST)]
    return joined([_abreast(atlas, block) for block in blocks])


def joined(parts: Sequence[Walks]) -> Walks:
    """All of several walks."""
    return Walks(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _abreast(atlas: Atlas, found: Sequence[Lot]) -> Walks:
    bodies = [CRobot(lot.damage, lot.strike, lot.seed, lot.world) for lot in found]
    about, actors = atlas.about, jax.tree.map(jnp.asarray, atlas.actors)
    acts = partial(_acts, task=about["task"], kind=about["observation"], config=atlas.network)
    senses, rows = [body.reset() for body in bodies], []
    filler = [0] * (ABREAST - len(found))  # the program has one shape
    for step in range(STEPS):
        policy = np.array([lot.policy[step] for lot in found] + filler)
        phase = np.array([lot.phase + step * about["clock_hz"] / CONTROL_HZ for lot in found] + filler) % 1.0
        stacked = _stacked(senses + senses[:1] * len(filler))
        action = np.asarray(acts(actors, policy, stacked, phase.astype(np.float32)))[: len(found)]
        senses = [body.step(own) for body, own in zip(bodies, action, strict=True)]
        after = _stacked(senses)
        rows.append((action, np.concatenate([after.joints, after.gyroscope, after.gravity], axis=1), after.answering))
    action, felt, answering = (np.stack(part, axis=1) for part in zip(*rows, strict=True))
    return Walks(action, felt, answering, labels(found))


def labels(found: Sequence[Lot]) -> np.ndarray:
    """The damage in which every step was made, i32[N, T]; 0 is healthy."""
    broken = np.arange(STEPS)[None] >= np.array([lot.strike for lot in found])[:, None]
    return np.where(broken, np.array([lot.label for lot in found])[:, None], 0).astype(np.int32)


def _stacked(senses: Sequence[Senses]) -> Senses:
    return jax.tree.map(lambda *leaves: np.stack(leaves), *senses)


@partial(jax.jit, static_argnames=("task", "kind", "config"))
def _acts(
    actors: Params, policy: jax.Array, senses: Senses, phase: jax.Array, *, task: str, kind: str, config: DDPGConfig
) -> jax.Array:
    """Actions f32[N, 18] of N robots, each by its own policy i32[N] of all, leaves [I, ...]."""

    def act(index: jax.Array, felt: Senses, clock: jax.Array) -> jax.Array:
        seen = feeling.observation(felt, clock, task=task, kind=kind)
        return behaviour.policy(jax.tree.map(lambda leaf: leaf[index], actors), seen, config=config)

    return jax.vmap(act)(policy, senses, phase)
