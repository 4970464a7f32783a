"""The same walks (`walks`) in the simulator that an atlas is trained in, all robots in one program.

What can differ there as a value does: mass, stiffness of the servos, payload, noise and bias of the sensors; friction
differs from block to block. It has no slopes. It is many times as fast as C MuJoCo at 2 ms.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from experiments.estimating.walks import STEPS, Lot, Walks, joined, labels
from srl_jax.agents import behaviour
from srl_jax.agents.settings import DDPGConfig
from srl_jax.atlas.file import Atlas
from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env import senses as feeling
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import CONTROL_HZ, EnvState, Hexapod
from srl_jax.env.senses import FELT_NOISE, Senses
from srl_jax.env.settings import EnvConfig
from srl_jax.types import Params

FRICTIONS = (0.5, 0.8, 1.1)  # shares of the model's; a program each
ABREAST = 1024  # robots of a program


class Robots(NamedTuple):
    """One robot; leaves have an axis more where they are of several."""

    healthy: Damage
    damage: Damage
    strike: jax.Array  # i32[]
    policy: jax.Array  # i32[T]
    phase: jax.Array  # f32[]
    bias: jax.Array  # f32[] as of `World`
    key: jax.Array


def walked(atlas: Atlas, found: Sequence[Lot], frictions: Sequence[float] = FRICTIONS, abreast: int = ABREAST) -> Walks:
    """The walks of so many robots; those that the physics lost are left out."""
    about, parts = atlas.about, []
    base = hexapod.make(about["task"], EnvConfig(observation=about["observation"]), about["clock_hz"])
    actors = jax.tree.map(jnp.asarray, atlas.actors)
    for friction, share in zip(frictions, np.array_split(np.arange(len(found)), len(frictions)), strict=True):
        walk = jax.jit(jax.vmap(partial(_walk, _on_floor(base, friction), atlas.network), (None, 0)))
        for first in range(0, len(share), abreast):
            block = [found[i] for i in share[first : first + abreast]]
            filled = block + block[-1:] * (abreast - len(block))
            action, felt, answering = (part[: len(block)] for part in jax.device_get(walk(actors, _robots(filled))))
            sound = np.isfinite(felt).all(axis=(1, 2))
            parts.append(Walks(action[sound], felt[sound], answering[sound], labels(block)[sound]))
    return joined(parts)


def _on_floor(robot: Hexapod, friction: float) -> Hexapod:
    """On a floor with this share of the model's friction; where MJX steps it, on the model's own."""
    star = robot.star
    return robot._replace(star=star and dataclasses.replace(star, friction=star.friction * friction))


def _robots(found: Sequence[Lot]) -> Robots:
    """Leaves [N, ...]; worlds change what `CRobot` changes too."""
    names = list(dict.fromkeys([damage_names.HEALTHY, *(lot.damage for lot in found)]))
    index, every = {name: i for i, name in enumerate(names)}, damages.stack(names)
    worlds = [lot.world for lot in found]
    mass, gain, payload = (np.array([getattr(w, f) for w in worlds], np.float32) for f in ("mass", "gain", "payload"))

    def changed(rows: np.ndarray) -> Damage:
        own = jax.tree.map(lambda leaf: leaf[rows], every)
        heavier = own.body_mass * mass[:, None]
        heavier[:, 1] += payload
        stiffness, pull = own.actuator_gainprm.copy(), own.actuator_biasprm.copy()
        stiffness[:, :, 0] *= gain[:, None]
        pull[:, :, 1] *= gain[:, None]
        turned = own.body_inertia * mass[:, None, None]
        return own._replace(body_mass=heavier, body_inertia=turned, actuator_gainprm=stiffness, actuator_biasprm=pull)

    return Robots(
        healthy=changed(np.zeros(len(found), int)),
        damage=changed(np.array([index[lot.damage] for lot in found])),
        strike=jnp.array([lot.strike for lot in found]),
        policy=jnp.array(np.stack([lot.policy for lot in found])),
        phase=jnp.array([lot.phase for lot in found], jnp.float32),
        bias=jnp.array([world.bias for world in worlds], jnp.float32),
        key=jax.vmap(jax.random.key)(np.array([lot.seed for lot in found], np.uint32)),
    )


def _walk(robot: Hexapod, network: DDPGConfig, actors: Params, one: Robots):
    """What a robot did and felt: f32[T, 18], f32[T, 24], bool[T, 18]."""
    start_key, bias_key, noise_key = jax.random.split(one.key, 3)
    bias = one.bias * FELT_NOISE * jax.random.normal(bias_key, (feeling.SIZE,))
    bias = bias.at[feeling.ANGLES].set(0.0)

    def sense(damage: Damage, state: EnvState, t: jax.Array) -> Senses:
        true = hexapod.feel(robot, damage, state)
        off = bias + FELT_NOISE * jax.random.normal(jax.random.fold_in(noise_key, t), (feeling.SIZE,))
        return true._replace(
            joints=jnp.where(true.answering, true.joints + off[feeling.ANGLES], 0.0),
            gyroscope=true.gyroscope + off[feeling.GYROSCOPE],
            gravity=true.gravity + off[feeling.GRAVITY],
        )

    def advance(carry: tuple[EnvState, Senses], t: jax.Array):
        state, senses = carry
        phase = jnp.mod(one.phase + t * robot.clock_hz / CONTROL_HZ, 1.0)
        seen = feeling.observation(senses, phase, task=robot.task, kind=robot.config.observation)
        actor = jax.tree.map(lambda leaf: leaf[one.policy[t]], actors)
        action = behaviour.policy(actor, seen, config=network)
        damage = jax.tree.map(lambda old, new: jnp.where(t < one.strike, old, new), one.healthy, one.damage)
        state = hexapod.simulate(robot, damage, state, hexapod.targets(robot, action))
        senses = sense(damage, state, t)
        return (state, senses), (action, feeling.felt(senses), senses.answering)

    standing, _ = hexapod.reset(robot, one.healthy, start_key)
    start = standing, sense(one.healthy, standing, jnp.int32(STEPS))
    return jax.lax.scan(advance, start, jnp.arange(STEPS))[1]
