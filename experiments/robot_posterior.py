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
from typing import Annotated, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from jax.tree_util import Partial
from rich.console import Console
from rich.table import Table

from srl_jax.agents.ensemble import critic_fn
from srl_jax.agents.hyper import from_config
from srl_jax.agents.interface import Teacher
from srl_jax.agents.settings import SRLConfig
from srl_jax.bayes import calibration, dropout, guidance, thompson
from srl_jax.cli.ending import leave
from srl_jax.env import damage as damages
from srl_jax.env import hexapod
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import EnvState, Hexapod
from srl_jax.job.students import Run, open_run
from srl_jax.program.lanes import Lane
from srl_jax.program.randomness import lane_keys, per_robot
from srl_jax.types import Params

LEVELS = (0.5, 0.8, 0.95)
FEWEST = 20  # draws that have an interval of the widest level
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


class Learned(NamedTuple):
    """What is judged of one lane."""

    policy: Partial  # its student
    teacher: Teacher  # its pi_B, a pytree as the policy is
    critic: Params  # leaves [K, ...]
    gamma: jax.Array  # f32[]
    dropout: jax.Array  # f32[] rate


class Judged(NamedTuple):
    """One state: what the posterior says, and what came of it."""

    probability: jax.Array  # f32[] P[Q(s, pi_B) > Q(s, pi)]
    draws: jax.Array  # f32[M] of Q(s, pi(s))
    teacher: jax.Array  # f32[] discounted return of pi_B's action, then the student
    own: jax.Array  # f32[] and of the student throughout


def returned(robot: Hexapod, damage: Damage, start: EnvState, action: jax.Array, policy, gamma: jax.Array, steps: int):
    """Discounted return f32[] of one given action f32[18] and then a policy, until success, a fall or `steps`."""

    def control(carry, index):
        state, action_, going = carry
        state, out = hexapod.step(robot, damage, state, action_)
        earned = going * gamma**index * out.reward
        return (state, policy(out.observation), going * (1.0 - out.terminated)), earned

    begin = (start, action, jnp.float32(1.0))
    return jax.lax.scan(control, begin, jnp.arange(steps, dtype=jnp.float32))[1].sum()


def judge(robot: Hexapod, config: SRLConfig, sizes: tuple[int, int, int], lane: Learned, damage: Damage, key):
    """One robot of one lane: an episode with noise, and at its visited states the judgement and the rollouts."""
    visits, horizon, count = sizes
    reset_key, noise_key, mask_key = jax.random.split(key, 3)
    state, observation = hexapod.reset(robot, damage, reset_key)
    every = robot.config.episode_steps // (visits + 1)

    def wander(carry, key):
        state, observation = carry
        noise = NOISE * jax.random.normal(key, (hexapod.ACTION_SIZE,))
        state, out = hexapod.step(robot, damage, state, jnp.clip(lane.policy(observation) + noise, -1.0, 1.0))
        return (state, out.observation), (state, out.observation, out.terminated)

    keys = jax.random.split(noise_key, visits * every)
    _, (states, observations, ended) = jax.lax.scan(wander, (state, observation), keys)
    alive = jnp.cumsum(ended) == 0
    pick = lambda x: x.reshape(visits, every, *x.shape[1:])[:, -1]  # noqa: E731
    states, observations, alive = jax.tree.map(pick, (states, observations, alive))
    masks = dropout.sample_masks(mask_key, config.hidden, (config.critics, count // config.critics), lane.dropout)

    def at(state: EnvState, observation: jax.Array) -> Judged:
        actions = jnp.stack([lane.policy(observation), lane.teacher(observation)])
        draws = dropout.q_draws(critic_fn(config), lane.critic, observation, actions, masks)
        roll = lambda action: returned(robot, damage, state, action, lane.policy, lane.gamma, horizon)  # noqa: E731
        own, other = jax.lax.map(roll, actions)
        return Judged(thompson.probability_better(draws, 1, 0), draws[:, 0], other, own)

    return jax.vmap(at)(states, observations), alive


def table_row(name: str, judged: Judged, alive: np.ndarray) -> list[str]:
    """One damage's line: area under the curve, coverage, bias. Arrays have axes [lane, robot, visit]."""
    if not alive.any():
        return [name, "0"]
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


def settings(run: Run, arguments: Arguments) -> SRLConfig:
    """The settings of the algorithm whose posterior is judged.

    Raises:
        ValueError: the run does not have it, it has no posterior, or the numbers do not suit the run.
    """
    for name in ("seeds", "robots", "visits", "horizon", "draws"):
        if getattr(arguments, name) < 1:
            raise ValueError(f"{name} is {getattr(arguments, name)}; at least 1 is needed.")
    run.lanes_of(arguments.algo)
    found, steps = run.config.agent(arguments.algo), run.config.env.episode_steps
    if not isinstance(found, SRLConfig):
        able = [algo for algo in run.algos if isinstance(run.config.agent(algo), SRLConfig)]
        raise ValueError(
            f"algo is {arguments.algo!r}, whose critic has no posterior: of {run.directory} choose "
            f"{', '.join(able) or 'none, it has no such algorithm'}."
        )
    if arguments.draws % found.critics or arguments.draws < FEWEST:
        raise ValueError(
            f"draws is {arguments.draws}; a multiple of the {found.critics} critics, at least {FEWEST}, is needed."
        )
    if arguments.visits >= steps:
        raise ValueError(f"visits is {arguments.visits}; fewer than the {steps} steps of an episode are needed.")
    return found


def learned(run: Run, config: SRLConfig, lane: Lane) -> Learned:
    """A lane's student, critic and pi_B, with the values that its variant has chosen."""
    hyper = from_config(config, **dict(lane.variant))
    return Learned(run.policy(lane), run.advisers(lane)[0], run.learned(lane)["critic"], hyper.gamma, hyper.dropout)


def main(arguments: Arguments) -> None:
    """Rolls out and prints one line for every damage, and variant where there are several."""
    run = open_run(arguments.run)
    config = settings(run, arguments)
    one = partial(judge, run.robot, config, (arguments.visits, arguments.horizon, arguments.draws))
    robots = jax.jit(jax.vmap(one, (None, None, 0)))
    names = ["damage", "states", "pi_B better", "p > 1/2", "AUC of p"]
    names += [f"{level:.0%} covers" for level in LEVELS]
    table = Table(*names, "std of Q", "return - Q", "its std", box=None)
    groups: dict[str, list[Lane]] = {}
    for lane in run.lanes_of(arguments.algo):
        groups.setdefault(f"{run.damage(lane)} {lane.label}".strip(), []).append(lane)
    found: list[tuple[Judged, np.ndarray]] = []
    for name, lanes in groups.items():
        lanes = lanes[: arguments.seeds]
        keys = per_robot(lane_keys(lanes, "posterior"), 0, arguments.robots)
        parts = [
            jax.device_get(robots(learned(run, config, lane), damages.build(run.damage(lane)), own))
            for lane, own in zip(lanes, keys, strict=True)
        ]
        found.append(jax.tree.map(lambda *x: np.stack(x), *parts))
        table.add_row(*table_row(name, *found[-1]))
    table.add_row(*table_row("all", *jax.tree.map(lambda *x: np.concatenate(x), *found)))
    Console(width=150).print(table)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
