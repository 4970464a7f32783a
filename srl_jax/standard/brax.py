"""The robot as a pure environment of Brax's shape: ``reset(key) -> State``, ``step(state, action) -> State``.

What Brax trains with takes it as it is (MuJoCo Playground trains with the same). Brax itself is not needed. Damage is
its ``sys``, so that Brax's randomisation batches damages: one robot of the batch lacks a leg, its neighbour a tibia.
"""

from collections.abc import Callable
from typing import Any

import flax.struct
import jax
import jax.numpy as jnp

from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env import gait as gaits
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import ACTION_SIZE, CONTROL_HZ, EnvState, observation_size
from srl_jax.env.task import RewardTerms
from srl_jax.standard.settings import Settings, configured

METRICS = (*(f"reward/{name}" for name in RewardTerms._fields), "success", "fell", "progress")


@flax.struct.dataclass
class State:
    """The robot after a step; the fields of ``brax.envs.State``."""

    pipeline_state: EnvState
    obs: jax.Array  # f32[O]
    reward: jax.Array  # f32[]
    done: jax.Array  # f32[] 1 where the goal is reached or the robot has tipped over
    metrics: dict[str, jax.Array]  # f32[] each: terms of the reward, success, fell, progress (m)
    info: dict[str, Any]  # truncation f32[]: 1 where it is out of time; and what wrappers leave there


class Hexapod:
    """A damaged robot and its task, unbatched, without auto-reset: both are the wrappers' work."""

    backend = "srl_jax"
    action_size = ACTION_SIZE
    dt = 1.0 / CONTROL_HZ  # s

    def __init__(
        self, task: str = "p2p", damage: str = "healthy", *, settings: Settings = None, clock_hz: float | None = None
    ):
        """A robot to be trained.

        Args:
            task: x, xy or p2p.
            damage: a name of `damage_names`; several: see `among`.
            settings: fields of `EnvConfig` that shall be others, such as ``{"physics": "mjx"}``, or a whole one.
                Brax's wrappers cut episodes off by themselves: give them ``episode_steps`` as their episode length.
            clock_hz: of the gait's clock in the observation; None: the scripted gait's.

        Raises:
            ValueError: something is none of these.
        """
        config, name = configured(task, settings), damage_names.canonical(damage)
        self.robot = hexapod.make(task, config, float(gaits.load().frequency) if clock_hz is None else clock_hz)
        self.sys: Damage = jax.tree.map(jnp.asarray, damages.build(name))  # wrappers set it
        self.observation_size = observation_size(task, config)

    @property
    def unwrapped(self) -> "Hexapod":
        """Itself: what wrappers ask for."""
        return self

    def reset(self, rng: jax.Array) -> State:
        """A robot on its feet; `rng` is one key."""
        state, observation = hexapod.reset(self.robot, self.sys, rng)
        zero = jnp.zeros(())
        return State(state, observation, zero, zero, dict.fromkeys(METRICS, zero), {"truncation": zero})

    def step(self, state: State, action: jax.Array) -> State:
        """One control step of 1/20 s under an action f32[18] in [-1, 1]."""
        reached, out = hexapod.step(self.robot, self.sys, state.pipeline_state, action)
        values = (*out.terms, out.success, out.fell, out.progress)
        metrics = {name: value.astype(jnp.float32) for name, value in zip(METRICS, values, strict=True)}
        return state.replace(  # pyright: ignore[reportAttributeAccessIssue]  flax adds it
            pipeline_state=reached,
            obs=out.observation,
            reward=out.reward,
            done=out.terminated.astype(jnp.float32),
            metrics={**state.metrics, **metrics},
            info={**state.info, "truncation": out.truncated.astype(jnp.float32)},
        )


def among(names: str, task: str = "p2p") -> Callable[[Damage, jax.Array], tuple[Damage, Damage]]:
    """Brax's ``randomization_fn``: every robot of a batch draws its damage.

    Args:
        names: names and sets as of ``srl-jax run --damage``, such as ``losses21,healthy``.
        task: which decides what the set ``task`` is.

    Returns:
        (sys, keys [N]) -> damages with a leading axis N, and the axes that `vmap` is told.

    Raises:
        ValueError: a bad damage name.
    """
    every = damages.stack(damage_names.parse_names(names, task))
    count = len(every.body_mass)

    def randomised(sys: Damage, rng: jax.Array) -> tuple[Damage, Damage]:
        drawn = jax.vmap(lambda key: jax.random.randint(key, (), 0, count))(rng)
        return jax.tree.map(lambda x: jnp.asarray(x)[drawn], every), jax.tree.map(lambda _: 0, sys)

    return randomised
