"""What a trained critic's posterior is worth on the robot: sees it where pi_B helps, and is it as wide as its errors?

    python -m experiments.robot_posterior runs/p2p

From states that the student visits, with exploration noise, two rollouts are made on the damaged robot: the student
throughout, and pi_B's action once before it. Which was better is what ``P[Q(s, pi_B) > Q(s, pi)]`` claims to predict;
the student's return is what the draws of ``Q(s, pi(s))`` claim to cover. Returns are discounted and know no time limit:
150 steps, where gamma^150 is .01.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from srl_jax.agents.ddpg import student
from srl_jax.agents.ensemble import critic_fn
from srl_jax.bayes import calibration, dropout, guidance, thompson
from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.hexapod import EnvState, Hexapod
from srl_jax.job import checkpoint, plan
from srl_jax.job import files as output
from srl_jax.job import teachers as sources
from srl_jax.program import lanes as lane_table

LEVELS = (0.5, 0.8, 0.95)
NOISE = 0.25


@dataclass(frozen=True)
class Arguments:
    """Which run, and how many states."""

    run: Annotated[Path, tyro.conf.Positional]
    algo: str = "srl"
    seeds: int = 4
    """Lanes of each damage."""
    robots: int = 16
    """Robots of each lane."""
    visits: int = 4
    """States of each robot, evenly spaced over an episode."""
    horizon: int = 150
    draws: int = 64


class Judged(NamedTuple):
    """One state: what the posterior says, and what came of it."""

    probability: jax.Array  # f32[] P[Q(s, pi_B) > Q(s, pi)]
    draws: jax.Array  # f32[M] of Q(s, pi(s))
    teacher: jax.Array  # f32[] discounted return of pi_B's action, then the student
    own: jax.Array  # f32[] and of the student throughout


def returned(robot: Hexapod, damage: Any, start: EnvState, action: jax.Array, policy, gamma: float, steps: int):
    """Discounted return f32[] of one given action f32[18] and then a policy, until success, a fall or `steps`."""

    def control(carry, index):
        state, action_, going = carry
        state, out = hexapod.step(robot, damage, state, action_)
        earned = going * gamma**index * out.reward
        return (state, policy(out.observation), going * (1.0 - out.terminated)), earned

    begin = (start, action, jnp.float32(1.0))
    return jax.lax.scan(control, begin, jnp.arange(steps, dtype=jnp.float32))[1].sum()


def judge(robot: Hexapod, teacher, config, gamma: float, sizes: tuple[int, int, int], damage, networks, rate, key):
    """One robot of one lane: an episode with noise, and at its visited states the judgement and the rollouts."""
    visits, horizon, count = sizes
    policy = partial(student, networks["actor"], config=config)
    reset_key, noise_key, mask_key = jax.random.split(key, 3)
    state, observation = hexapod.reset(robot, damage, reset_key)
    every = robot.config.episode_steps // (visits + 1)

    def wander(carry, key):
        state, observation = carry
        action = jnp.clip(policy(observation) + NOISE * jax.random.normal(key, (hexapod.ACTION_SIZE,)), -1.0, 1.0)
        state, out = hexapod.step(robot, damage, state, action)
        return (state, out.observation), (state, out.observation, out.terminated)

    keys = jax.random.split(noise_key, visits * every)
    _, (states, observations, ended) = jax.lax.scan(wander, (state, observation), keys)
    alive = jnp.cumsum(ended) == 0
    pick = lambda x: x.reshape(visits, every, *x.shape[1:])[:, -1]  # noqa: E731
    states, observations, alive = jax.tree.map(pick, (states, observations, alive))
    shape = (config.critics, count // config.critics)
    masks = dropout.sample_masks(mask_key, config.hidden, shape, rate)

    def at(state: EnvState, observation: jax.Array) -> Judged:
        actions = jnp.stack([policy(observation), teacher(observation)])
        draws = dropout.q_draws(critic_fn(config), networks["critic"], observation, actions, masks)
        roll = lambda action: returned(robot, damage, state, action, policy, gamma, horizon)  # noqa: E731
        own, other = jax.lax.map(roll, actions)
        return Judged(thompson.probability_better(draws, 1, 0), draws[:, 0], other, own)

    return jax.vmap(at)(states, observations), alive


def table_row(name: str, judged: Judged, alive: np.ndarray) -> list[str]:
    """One damage's line: area under the curve, coverage, bias. Arrays have axes [lane, robot, visit]."""
    lane = np.broadcast_to(np.arange(len(alive))[:, None, None], alive.shape)
    episode = (lane * alive.shape[1] + np.arange(alive.shape[1])[None, :, None])[alive]
    probability, draws, teacher, own = (np.asarray(x)[alive] for x in judged)
    differ = teacher != own
    better = teacher > own
    try:
        area = guidance.auc(probability[differ], better[differ], episode[differ])
        text = f"{area.point:.2f} [{area.low:.2f}, {area.high:.2f}]"
    except ValueError:
        text = "one outcome only"
    covered = calibration.coverage(draws.T, own, LEVELS)
    error = own - draws.mean(1)
    cells = [f"{alive.sum()}", f"{better.mean():.2f}", f"{(probability > 0.5).mean():.2f}", text]
    cells += [f"{share:.2f}" for share in covered]
    return [name, *cells, f"{draws.std(1, ddof=1).mean():.2f}", f"{error.mean():+.2f}", f"{error.std():.2f}"]


def main() -> None:
    """Rolls out and prints one line per damage."""
    arguments = tyro.cli(Arguments)
    config, devices = output.read_config(arguments.run)
    lanes = plan.make(config).lanes
    rows = lane_table.lay_out(lanes, devices).of(arguments.algo)
    networks = checkpoint.networks(arguments.run / "checkpoints")[arguments.algo]
    agent, gait = getattr(config, arguments.algo), sources.scripted_gait()
    robot = hexapod.make(config.task, config.env, gait.clock_hz)
    teacher = partial(gait.apply, gait.params(lanes[0]))
    sizes = (arguments.visits, arguments.horizon, arguments.draws)
    one = partial(judge, robot, teacher, agent, agent.gamma[0], sizes)
    robots = jax.jit(jax.vmap(one, (None, None, None, 0)))
    names = ["damage", "states", "pi_B better", "p > 1/2", "AUC of p"]
    names += [f"{level:.0%} covers" for level in LEVELS]
    table = Table(*names, "std of Q", "return - Q", "its std", box=None)
    found: list[tuple[Judged, np.ndarray]] = []
    for damage in dict.fromkeys(lane.damage for lane in lanes):
        own = [lane for lane in dict.fromkeys(rows) if lane.damage == damage][: arguments.seeds]
        parts = []
        for lane in own:
            row = rows.index(lane)
            learned = jax.tree.map(lambda x, row=row: x[row], networks)
            keys = jax.random.split(lane_table.key(lane, "posterior"), arguments.robots)
            rate = jnp.float32(dict(lane.variant).get("dropout", agent.dropout[0]))
            parts.append(jax.device_get(robots(damages.build(damage), learned, rate, keys)))
        judged, alive = jax.tree.map(lambda *x: np.stack(x), *parts)
        table.add_row(*table_row(damage, judged, alive))
        found.append((judged, alive))
    judged, alive = jax.tree.map(lambda *x: np.concatenate(x), *found)
    table.add_row(*table_row("all", judged, alive))
    Console(width=150).print(table)


if __name__ == "__main__":
    leave(main)
