"""Tune the scripted gait pi_B on the healthy robot: the cross-entropy method over whole episodes, all in one program.

A candidate walks straight ahead and to a few goals all around it. Every generation draws new goals, joint noise and clock
phases, the same for all of its candidates; what is reported comes from draws that the search has not seen.
"""

import dataclasses
import json
import sys
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import tyro

from srl_jax.config import EnvConfig
from srl_jax.env import damage as damages
from srl_jax.env import gait as gaits
from srl_jax.env import hexapod, model
from srl_jax.env.damage import Damage
from srl_jax.env.gait import Gait

FAR = 1e3  # m: so far ahead, a goal is a direction
LOW = 0.06  # m: below this height of the torso the belly is about to touch
STALL = 1.5 / 12.0  # rad: error of position at which a servo's torque saturates
BOUNDS = {
    "frequency": (0.8, 2.2),
    "stride": (0.0, 1.0),
    "reach": (0.0, 1.0),
    "level": (-0.8, 0.4),
    "lift": (0.2, 1.0),
    "tuck": (-0.6, 0.6),
    "press": (-0.3, 0.5),
    "crouch": (-0.4, 0.4),
    "lag": (-0.12, 0.12),
    "turn": (-0.2, 0.8),
}


@dataclasses.dataclass(frozen=True)
class Settings:
    """The search; a generation costs population x (1 + goals) episodes."""

    seed: int = 0
    population: int = 128
    elite: int = 16
    generations: int = 30
    goals: int = 4
    keep: float = 0.3
    """Share of the old mean and standard deviation in the new ones."""
    block: int = 128
    """Robots stepped together: as many as fit the cache."""
    test: int = 128
    """Episodes of each kind (straight ahead, to a goal) in the report, per damage."""


class Walk(NamedTuple):
    """What an episode showed."""

    x: jax.Array  # f32[] m along x at its end
    success: jax.Array  # bool[] goal reached, and not tipped over before
    time: jax.Array  # f32[] share of the episode until then; 1 without success
    fell: jax.Array  # bool[] tipped over before success
    tilt: jax.Array  # f32[] mean of 1 - cosine of the tilt
    low: jax.Array  # f32[] share of steps that end with the torso below LOW
    stalled: jax.Array  # f32[] share of servos and steps that end at full torque


def walk(robot: hexapod.Hexapod, gait: Gait, damage: Damage, goal: jax.Array, key: jax.Array) -> Walk:
    """One episode of a p2p robot towards `goal` f32[2], whatever clock frequency it was made with."""
    robot = robot._replace(clock_hz=gait.frequency)
    state = hexapod.reset(robot, damage, key)[0]._replace(goal=goal)

    def control(carry, _):
        state, observation, done, fell = carry
        action = gaits.act(gait, observation)
        state, out = hexapod.step(robot, damage, state, action)
        fell = fell | (out.fell & ~done)
        done = done | (out.success & ~fell)
        tilt = 1.0 - hexapod.rotation(state.qpos[3:7])[2, 2]
        stalled = jnp.abs(hexapod.targets(robot, action) - state.qpos[7:]) > STALL
        return (state, out.observation, done, fell), (1.0 - done, tilt, state.qpos[2] < LOW, jnp.mean(stalled))

    carry = (state, hexapod.observe(robot, state), jnp.bool_(False), jnp.bool_(False))
    (state, _, done, fell), each = jax.lax.scan(control, carry, None, length=robot.config.episode_steps)
    time, tilt, low, stalled = (jnp.mean(part) for part in each)
    return Walk(state.qpos[0], done, time, fell, tilt, low, stalled)


def draw_goals(config: EnvConfig, count: int, key: jax.Array) -> jax.Array:
    """Goals f32[count, 2] from the task's ring, evenly spread over the circle after a random turn."""
    angle_key, radius_key = jax.random.split(key)
    angle = 2.0 * jnp.pi * (jax.random.uniform(angle_key) + jnp.arange(count) / count)
    radius = jax.random.uniform(radius_key, (count, 1), minval=config.goal_ring[0], maxval=config.goal_ring[1])
    return radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)


def score(seen: Walk) -> jax.Array:
    """Value of a candidate from its episodes f32[1 + goals], the first of them straight ahead."""
    goals = jnp.mean((seen.success - 0.5 * seen.time)[1:])
    return 0.4 * seen.x[0] + goals - jnp.mean(5.0 * seen.tilt + seen.low + 0.5 * seen.stalled + seen.fell)


def search(settings: Settings, config: EnvConfig, run: Callable[..., Walk], key: jax.Array) -> Gait:
    """The cross-entropy method: its last mean, of the `elite` best in each generation."""
    low, high = jnp.array(list(BOUNDS.values())).T
    mean, deviation = (low + high) / 2.0, (high - low) / 4.0
    rows = (settings.population, 1 + settings.goals)
    healthy = damages.build(damages.HEALTHY)
    for generation in range(settings.generations):
        key, sample_key, goal_key, reset_key = jax.random.split(key, 4)
        noise = jax.random.normal(sample_key, (rows[0], len(BOUNDS))).at[0].set(0.0)
        candidates = jnp.clip(mean[None] + deviation[None] * noise, low[None], high[None])
        goals = jnp.concatenate([jnp.array([[FAR, 0.0]]), draw_goals(config, settings.goals, goal_key)])
        resets = jnp.tile(jax.random.split(reset_key, rows[1]), rows[0])
        seen = run(Gait(*jnp.repeat(candidates, rows[1], axis=0).T), healthy, jnp.tile(goals, (rows[0], 1)), resets)
        scores = jax.vmap(score)(jax.tree.map(lambda leaf: leaf.reshape(rows), seen))
        elite = candidates[jnp.argsort(-scores)[: settings.elite]]
        mean = settings.keep * mean + (1.0 - settings.keep) * jnp.mean(elite, axis=0)
        deviation = settings.keep * deviation + (1.0 - settings.keep) * jnp.std(elite, axis=0)
        print(f"generation {generation:2d}: mean {scores[0]:.3f}, best {scores.max():.3f}", flush=True)
    return Gait(*(jnp.float32(round(float(value), 4)) for value in mean))


def measure(seen: Walk, seconds: float) -> dict[str, float]:
    """Means over episodes, of which the first half went straight ahead and the others to goals."""
    ahead, p2p = (jax.tree.map(lambda leaf: np.split(np.asarray(leaf), 2)[half], seen) for half in (0, 1))
    return {
        "x_m": float(ahead.x.mean()),
        "speed_m_per_s": float(ahead.x.mean() / seconds),
        "p2p_success": float(p2p.success.mean()),
        "p2p_seconds": float(seconds * p2p.time.mean()),
        "fell": float(np.mean([ahead.fell, p2p.fell])),
        "tilt_degrees": float(np.degrees(np.arccos(1.0 - ahead.tilt.mean()))),
        "stalled": float(ahead.stalled.mean()),
    }


def x_in_c(robot: hexapod.Hexapod, gait: Gait, key: jax.Array, fine: bool) -> float:
    """x (m) after an episode straight ahead in C MuJoCo, at the training's settings or with converged physics."""
    c_model, substeps = model.load_model(), hexapod.SUBSTEPS
    if fine:
        c_model.opt.timestep, substeps, c_model.opt.iterations = 0.002, 25, 50
        c_model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    data = mujoco.MjData(c_model)
    control = jax.jit(lambda state: gaits.act(gait, hexapod.observe(robot, state)))
    advance = jax.jit(lambda *args: hexapod.advance(robot, *args)[0])
    state, _ = hexapod.reset(robot, damages.build(damages.HEALTHY), key)
    state = state._replace(goal=jnp.array([FAR, 0.0]))
    data.qpos[:] = state.qpos
    for _ in range(robot.config.episode_steps):
        action = control(state)
        data.ctrl[:] = hexapod.targets(robot, action)
        mujoco.mj_step(c_model, data, substeps)
        state = advance(state, state._replace(qpos=jnp.float32(data.qpos), qvel=jnp.float32(data.qvel)), action)
    return float(data.qpos[0])


def main(settings: Settings) -> None:
    config = EnvConfig()
    seconds = config.episode_steps / hexapod.CONTROL_HZ
    robot = hexapod.make("p2p", config, 1.0)

    @jax.jit
    def run(gait: Gait, damage: Damage, goals: jax.Array, keys: jax.Array) -> Walk:
        return jax.lax.map(lambda row: walk(robot, row[0], damage, *row[1:]), (gait, goals, keys), batch_size=settings.block)

    search_key, goal_key, reset_key, c_key = jax.random.split(jax.random.key(settings.seed), 4)
    gait = search(settings, config, run, search_key)
    ahead = jnp.tile(jnp.array([[FAR, 0.0]]), (settings.test, 1))
    rows = (jnp.concatenate([ahead, draw_goals(config, settings.test, goal_key)]), jax.random.split(reset_key, 2 * settings.test))
    gaits_ = jax.tree.map(lambda leaf: jnp.full(2 * settings.test, leaf), gait)
    names = (damages.HEALTHY, *damages.task_set("x"), *damages.task_set("p2p"))
    table = {name: measure(run(gaits_, damages.build(name), *rows), seconds) for name in names}
    for name, row in table.items():
        print(f"{name:8}", *(f"{key} {value:.3f}" for key, value in row.items()), sep="  ")
    robot = robot._replace(clock_hz=float(gait.frequency))
    keys = jax.random.split(c_key, 8)
    c = {kind: np.mean([x_in_c(robot, gait, key, kind == "fine") for key in keys]) / seconds for kind in ("coarse", "fine")}
    measured = {"healthy": table.pop("healthy"), "speed_in_c": c, "damaged": table}
    measured = jax.tree.map(lambda x: round(float(x), 4), measured)
    print(measured)
    values = {n: round(float(v), 4) for n, v in gait._asdict().items()}
    command = " ".join(["python -m experiments.tune_gait", *sys.argv[1:]])
    gaits.DATA.write_text(json.dumps({"gait": values, "measured": measured, "command": command}, indent=2) + "\n")


if __name__ == "__main__":
    main(tyro.cli(Settings, description=__doc__))
