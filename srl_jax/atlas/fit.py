"""How far a true hypothesis is off: the covariance of its residuals on robots in worlds that it does not know."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour
from srl_jax.agents.settings import ActorConfig
from srl_jax.atlas import tracking
from srl_jax.atlas.robots import CRobot, World
from srl_jax.atlas.tracking import Gains
from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.env import senses as feeling
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import CONTROL_HZ, Hexapod
from srl_jax.types import Params

STEPS = 80  # control steps of a walk: four seconds
STRIKE = (20, 40)  # in which the damage comes
UNAWARE = 20  # control steps at most until the policy for the damage takes over from that for the healthy robot
START = 5  # control steps until the hypotheses' robots are where the real one is
FLOOR = 1e-5  # added to variances: a sense that was always right is not infinitely sure
WORLDS = {  # ranges of `World`
    "friction": (0.4, 1.2),
    "mass": (0.8, 1.2),
    "gain": (0.7, 1.1),
    "payload": (0.0, 0.5),
    "slope": (-5.0, 5.0),
    "bias": (0.0, 1.5),
}


class Walk(NamedTuple):
    """One robot under the policies that will walk it: leaves [STEPS, ...] but for the strike."""

    action: np.ndarray  # f32[T, 18]
    felt: np.ndarray  # f32[T, 24] after it
    answering: np.ndarray  # bool[T, 18]
    strike: np.ndarray  # i32[]


def whitening(
    robot: Hexapod,
    names: Sequence[str],
    walkers: Mapping[str, Params],
    config: ActorConfig,
    seed: int,
    gains: Gains = tracking.GAINS,
) -> np.ndarray:
    """L f32[24, 24] with ``L C L' = 1`` for the residuals of true hypotheses, one walk for every damage.

    How far a prediction is off depends on who walks: faster gaits slip more. So the policies walk that will.

    Args:
        robot: whose physics the hypotheses have, and what its policies see.
        names: the damages.
        walkers: a policy for each of them.
        config: their architecture.
        seed: of worlds, strikes and noise.
        gains: of the hypotheses' correction.
    """
    random = np.random.default_rng(seed)
    act = jax.jit(partial(behaviour.policy, config=config))
    walks = [_walk(robot, name, (walkers[damage_names.HEALTHY], walkers[name]), act, random) for name in names]
    stacked = Walk(*(np.stack(part) for part in zip(*walks, strict=True)))
    healthy = jax.tree.map(lambda x: np.broadcast_to(x, (len(names), *x.shape)), damages.build(damage_names.HEALTHY))
    pairs = jax.tree.map(lambda a, b: np.stack([a, b], axis=1), healthy, damages.stack(names))
    errors = np.asarray(jax.jit(jax.vmap(partial(_residuals, robot, gains)))(pairs, stacked))  # [N, T, 2, 24]
    steps = np.arange(STEPS)
    broken = steps[None] >= stacked.strike[:, None]
    true = np.where(broken[..., None], errors[:, :, 1], errors[:, :, 0])[:, START:].reshape(-1, feeling.SIZE)
    covariance = true.T @ true / len(true) + FLOOR * np.eye(feeling.SIZE)
    return np.linalg.inv(np.linalg.cholesky(covariance)).astype(np.float32)


def _walk(
    robot: Hexapod, name: str, walkers: tuple[Params, Params], act: Callable, random: np.random.Generator
) -> Walk:
    world = World(**{field: float(random.uniform(*limits)) for field, limits in WORLDS.items()})  # pyright: ignore
    strike, phase = int(random.integers(*STRIKE)), float(random.uniform())
    body = CRobot(name, strike, int(random.integers(2**31)), world)
    aware, senses, rows = strike + int(random.integers(UNAWARE + 1)), body.reset(), []
    for step in range(STEPS):
        seen = feeling.observation(
            _as_arrays(senses), jnp.float32(phase), task=robot.task, kind=robot.config.observation
        )
        action = np.asarray(act(walkers[step >= aware], seen))
        senses = body.step(action)
        rows.append((action, np.asarray(feeling.felt(_as_arrays(senses))), senses.answering))
        phase = (phase + robot.clock_hz / CONTROL_HZ) % 1.0
    action, felt, answering = (np.stack(part) for part in zip(*rows, strict=True))
    return Walk(action, felt, answering, np.array(strike))


def _as_arrays(senses: feeling.Senses) -> feeling.Senses:
    return jax.tree.map(jnp.asarray, senses)


def _residuals(robot: Hexapod, gains: Gains, damage: Damage, walk: Walk) -> jax.Array:
    """Residuals f32[T, D, 24] of D hypotheses over one walk."""
    follow = partial(tracking.follow, robot, damage, gains=gains)

    def advance(states, row):
        action, felt, answering = row
        return follow(states, action, felt, answering)

    start = tracking.at_rest(robot, len(damage.body_mass))
    return jax.lax.scan(advance, start, (walk.action, walk.felt, walk.answering))[1]
