"""Tune the scripted gait pi_B of a healthy robot, with the cross-entropy method over whole episodes.

A candidate walks straight ahead and to a few goals around it. Every generation draws new goals, joint noise
and clock phases, the same for all candidates; the report comes from draws that the search has not seen.
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import tyro

from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env import gait as gaits
from srl_jax.env.anatomy import PHANTOMX, Anatomy, named
from srl_jax.env.damage import Damage
from srl_jax.env.gait import Gait
from srl_jax.env.model import load_model
from srl_jax.env.settings import EnvConfig

#         frequency   stride      reach       level        lift        tuck         press        crouch
BOUNDS = ((0.8, 2.2), (0.0, 1.0), (0.0, 1.0), (-0.8, 0.4), (0.2, 1.0), (-0.6, 0.6), (-0.3, 0.5), (-0.4, 0.4))
BOUNDS += ((-0.12, 0.12), (-0.2, 0.8))  # lag, turn
CONFIG = EnvConfig()
ELITE = 16
KEEP = 0.3  # share of the old mean and standard deviation in the new ones
BLOCK = 128  # robots stepped together: as many as fit the cache
AHEAD = (1e3, 0.0)  # m: a goal so far away that it is a direction
CLEARANCE = 0.02  # m: below this height of the belly it is about to touch
Seen = dict[str, jax.Array]  # what an episode showed: see walk


@dataclass(frozen=True)
class Args:
    """How long to search, and on how much to judge."""

    robot: str = PHANTOMX.name
    """A robot that ships, or was registered (`env.anatomy`)."""
    seed: int = 0
    population: int = 128
    """Candidates of a generation."""
    generations: int = 8
    goals: int = 4
    """Goals of a candidate, besides straight ahead."""
    test: int = 64
    """Episodes of each kind in the report."""
    steps: int = CONFIG.episode_steps
    """Control steps (1/20 s) of an episode."""
    out: Path | None = None
    """The file of the gait and the report; the one that the robot's anatomy names unless given."""


class Limits(NamedTuple):
    """What a robot's model says of walking well."""

    low: float  # m: below this height of the torso the belly is about to touch
    stall: np.ndarray  # f32[J] rad: error of position at which a servo's torque saturates


def limits(anatomy: Anatomy) -> Limits:
    """The limits of a robot, from its model."""
    model = load_model(anatomy)
    touching = (model.geom_bodyid == model.body("torso").id) & (model.geom_contype > 0)
    deepest = np.max(model.geom_size[touching, 0] - model.geom_pos[touching, 2], initial=0.0)
    error = model.actuator_forcerange[:, 1] / model.actuator_gainprm[:, 0]
    stall = np.where(model.actuator_forcelimited, error, np.inf).astype(np.float32)
    return Limits(round(float(deepest) + CLEARANCE, 6), stall)


def walk(robot: hexapod.Hexapod, damage: Damage, gait: Gait, goal: jax.Array, key: jax.Array) -> Seen:
    """One episode of a p2p robot towards `goal` f32[2], whatever clock frequency it was made with.

    Returns x (m) at the end; success (no fall before) and time, the share of the episode until then; fell;
    means over the episode of tilt (1 - its cosine), low (torso), stalled (share of servos at full torque).
    """
    robot, act, limit = robot._replace(clock_hz=gait.frequency), gaits.walker(robot.anatomy), limits(robot.anatomy)
    state = hexapod.reset(robot, damage, key)[0]._replace(goal=goal)

    def control(carry, _):
        state, observation, done, fell = carry
        action = act(gait, observation)
        state, out = hexapod.step(robot, damage, state, action)
        fell = fell | (out.fell & ~done)
        done = done | (out.success & ~fell)
        tilt = 1.0 - hexapod.rotation(state.qpos[3:7])[2, 2]
        stalled = jnp.mean(jnp.abs(hexapod.targets(robot, action) - state.qpos[7:]) > limit.stall)
        return (state, out.observation, done, fell), (1.0 - done, tilt, state.qpos[2] < limit.low, stalled)

    carry = (state, hexapod.observe(robot, damage, state), jnp.bool_(False), jnp.bool_(False))
    (state, _, done, fell), each = jax.lax.scan(control, carry, None, length=robot.config.episode_steps)
    means = dict(zip(("time", "tilt", "low", "stalled"), map(jnp.mean, each), strict=True))
    return {"x": state.qpos[0], "success": done, "fell": fell, **means}


def draw_goals(count: int, key: jax.Array) -> jax.Array:
    """Goals f32[count, 2] from the task's ring, evenly spread over the circle after a random turn."""
    angle_key, radius_key = jax.random.split(key)
    angle = 2.0 * jnp.pi * (jax.random.uniform(angle_key) + jnp.arange(count) / count)
    radius = jax.random.uniform(radius_key, (count, 1), jnp.float32, *CONFIG.goal_ring)
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def score(seen: Seen) -> jax.Array:
    """Value of a candidate from its episodes f32[1 + goals], the first of them straight ahead."""
    goals = jnp.mean((seen["success"] - 0.5 * seen["time"])[1:])
    faults = 5.0 * seen["tilt"] + seen["low"] + 2.0 * seen["stalled"] + seen["fell"]
    return 0.4 * seen["x"][0] + goals - jnp.mean(faults)


def search(
    run: Callable[..., Seen], healthy: Damage, size: int, generations: int, goal_count: int, key: jax.Array
) -> Gait:
    """The cross-entropy method: its last mean, of the `elite` best in each generation."""
    low, high = jnp.array(BOUNDS).T
    mean, deviation = (low + high) / 2.0, (high - low) / 4.0
    each = 1 + goal_count
    for generation in range(generations):
        key, sample_key, goal_key, reset_key = jax.random.split(key, 4)
        noise = jax.random.normal(sample_key, (size, len(BOUNDS))).at[0].set(0.0)
        candidates = jnp.clip(mean[None] + deviation[None] * noise, low[None], high[None])
        goals = jnp.concatenate([jnp.array([AHEAD]), draw_goals(goal_count, goal_key)])
        resets = jnp.tile(jax.random.split(reset_key, each), size)
        rows = (Gait(*jnp.repeat(candidates, each, axis=0).T), jnp.tile(goals, (size, 1)), resets)
        seen = run(healthy, *rows)
        scores = jax.vmap(score)(jax.tree.map(lambda leaf: leaf.reshape(size, each), seen))
        elite = candidates[jnp.argsort(-scores)[:ELITE]]
        mean = KEEP * mean + (1.0 - KEEP) * jnp.mean(elite, axis=0)
        deviation = KEEP * deviation + (1.0 - KEEP) * jnp.std(elite, axis=0)
        print(f"generation {generation:2d}: mean {scores[0]:.3f}, best {scores.max():.3f}", flush=True)
    return Gait(*(jnp.float32(round(float(value), 4)) for value in mean))


def x_in_c(robot: hexapod.Hexapod, gait: Gait, keys: jax.Array, fine: bool) -> float:
    """Mean x (m) after episodes straight ahead in C MuJoCo, at training's settings or with converged physics."""
    c_model, substeps = load_model(robot.anatomy), hexapod.SUBSTEPS
    if fine:
        c_model.opt.timestep, substeps, c_model.opt.iterations = 0.002, 25, 50
        c_model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    healthy, act = damages.build(damage_names.HEALTHY, robot.anatomy), gaits.walker(robot.anatomy)
    decide = jax.jit(lambda state: act(gait, hexapod.observe(robot, healthy, state)))
    advance = jax.jit(lambda before, after, action: hexapod.advance(robot, healthy, before, after, action)[0])

    def episode(key: jax.Array) -> float:
        data = mujoco.MjData(c_model)
        state = hexapod.reset(robot, healthy, key)[0]._replace(goal=jnp.array(AHEAD))
        data.qpos[:] = state.qpos
        for _ in range(robot.config.episode_steps):
            action = decide(state)
            data.ctrl[:] = hexapod.targets(robot, action)
            mujoco.mj_step(c_model, data, substeps)
            after = state._replace(qpos=jnp.float32(data.qpos), qvel=jnp.float32(data.qvel))
            state = advance(state, after, action)
        return float(data.qpos[0])

    return float(np.mean([episode(key) for key in keys]))


def main(args: Args) -> None:
    """Searches, reports `test` episodes of each kind per damage, and writes the file.

    Raises:
        ValueError: no such robot, no episode to judge by, or fewer candidates than are selected.
    """
    for name, least in (("population", ELITE), ("generations", 1), ("goals", 1), ("test", 1), ("steps", 1)):
        if getattr(args, name) < least:
            raise ValueError(f"{name} is {getattr(args, name)}; at least {least} is needed.")
    anatomy, test = named(args.robot), args.test
    robot = hexapod.make("p2p", replace(CONFIG, episode_steps=args.steps), 1.0, anatomy)

    @jax.jit
    def run(damage: Damage, *rows) -> Seen:
        return jax.lax.map(lambda row: walk(robot, damage, *row), rows, batch_size=BLOCK)

    search_key, goal_key, reset_key, c_key = jax.random.split(jax.random.key(args.seed), 4)
    healthy = damages.build(damage_names.HEALTHY, anatomy)
    gait = search(run, healthy, args.population, args.generations, args.goals, search_key)
    targets = jnp.concatenate([jnp.tile(jnp.array([AHEAD]), (test, 1)), draw_goals(test, goal_key)])
    walkers = jax.tree.map(lambda leaf: jnp.full(2 * test, leaf), gait)
    measured = {}
    tasks = (name for task in ("x", "p2p") for name in damage_names.task_set(task, anatomy))
    for name in (damage_names.HEALTHY, *tasks):
        seen = run(damages.build(name, anatomy), walkers, targets, jax.random.split(reset_key, 2 * test))
        ahead = {key: seen[key][:test] for key in ("x", "tilt", "stalled")}
        p2p = {f"p2p_{key}": seen[key][test:] for key in ("success", "time")}
        table = {**ahead, **p2p, "fell": seen["fell"]}
        measured[name] = {key: round(float(value.mean()), 4) for key, value in table.items()}
        print(name, measured[name], flush=True)
    robot = robot._replace(clock_hz=float(gait.frequency))
    for name, fine in (("x_in_c", False), ("x_in_fine_c", True)):
        x = x_in_c(robot, gait, jax.random.split(c_key, 8), fine)
        print(name, measured[damage_names.HEALTHY].setdefault(name, round(x, 4)))
    command = " ".join(["python -m experiments.tune_gait", *sys.argv[1:]])
    values = {name: round(float(value), 4) for name, value in gait._asdict().items()}
    report = {"gait": values, "measured": measured, "command": command}
    (args.out or gaits.path(anatomy)).write_text(json.dumps(report, indent=2) + "\n")


if __name__ == "__main__":
    leave(main, tyro.cli(Args, description=__doc__))
