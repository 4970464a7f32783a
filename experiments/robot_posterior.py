"""What a trained critic's posterior is worth on the robot: sees it where pi_B helps, and is it as wide as its errors?

    python -m experiments.robot_posterior runs/p2p

From states that the student visits, with exploration noise, rollouts are made on the damaged robot: the student
throughout, and pi_B before it for one step, for a second, and for good. ``P[Q(s, pi_B) > Q(s, pi)]`` claims to predict
whether pi_B's step is better, and with ``values=policy`` ``P[V_1(s) > V_0(s)]`` whether following it for good is. Draws
of both values claim to cover what came of it. Returns are discounted and know no time limit: 150 steps, where gamma^150
is .01.
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

from srl_jax.agents import posterior
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
SECOND = 20  # control steps
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
    draws: jax.Array  # f32[M, 2] of what the student and pi_B are worth
    returned: jax.Array  # f32[4] discounted return with pi_B for 0, 1, 20 and all steps, and the student after it


def returned(robot: Hexapod, damage: Damage, lane: Learned, start: EnvState, first: jax.Array, lead, steps: int):
    """Discounted return f32[] of pi_B for `lead` steps and then the student, until success, a fall or `steps`."""

    def control(carry, index):
        state, observation, going = carry
        action = jnp.where(index < lead, lane.teacher(observation), lane.policy(observation))
        state, out = hexapod.step(robot, damage, state, action)
        earned = going * lane.gamma**index * out.reward
        return (state, out.observation, going * (1.0 - out.terminated)), earned

    begin = (start, first, jnp.float32(1.0))
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
        draws = posterior.draws(lane.critic, observation, actions, masks, config=config)
        roll = lambda lead: returned(robot, damage, lane, state, observation, lead, horizon)  # noqa: E731
        came = jax.lax.map(roll, jnp.array([0.0, 1.0, SECOND, horizon]))
        return Judged(thompson.probability_better(draws, 1, 0), draws, came)

    return jax.vmap(at)(states, observations), alive


def verdict_row(name: str, judged: Judged, alive: np.ndarray, claimed: int) -> list[str]:
    """One line of how well the better one was told. Arrays have axes [lane, robot, visit].

    Args:
        name: of the damage.
        judged: of all its states.
        alive: of which these count.
        claimed: which of the returns the probability is of.
    """
    if not alive.any():
        return [name, "0"]
    lane = np.broadcast_to(np.arange(len(alive))[:, None, None], alive.shape)
    episode = (lane * alive.shape[1] + np.arange(alive.shape[1])[None, :, None])[alive]
    probability, came = np.asarray(judged.probability)[alive], np.asarray(judged.returned)[alive]
    better = came[:, 1:] > came[:, :1]
    cells = [f"{alive.sum()}", f"{(probability > 0.5).mean():.2f}"]
    for which, label in enumerate(better.T, start=1):
        differ = came[:, which] != came[:, 0]
        try:
            area = guidance.auc(probability[differ], label[differ], episode[differ])
            text = f"{area.point:.2f} [{area.low:.2f}, {area.high:.2f}]"
        except ValueError:
            text = "one outcome only"
        cells += [f"{label.mean():.2f}", text]
    return [name, *cells, f"{calibration.expected_error(probability, better[:, claimed - 1]):.2f}"]


def worth_row(name: str, judged: Judged, alive: np.ndarray, claimed: int) -> list[str]:
    """One line of how well what student and pi_B are worth was told; arguments as `verdict_row`."""
    if not alive.any():
        return [name]
    draws, came = np.asarray(judged.draws)[alive], np.asarray(judged.returned)[alive][:, [0, claimed]]
    cells = []
    for who in range(2):
        covered = calibration.coverage(draws[..., who].T, came[:, who], LEVELS)
        error = came[:, who] - draws[..., who].mean(1)
        cells += [" ".join(f"{share:.2f}" for share in covered), f"{draws[..., who].std(1, ddof=1).mean():.2f}"]
        cells += [f"{error.mean():+.2f}", f"{error.std():.2f}"]
    return [name, *cells]


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
    """Rolls out and prints two lines for every damage, and variant where there are several."""
    run = open_run(arguments.run)
    config = settings(run, arguments)
    one = partial(judge, run.robot, config, (arguments.visits, arguments.horizon, arguments.draws))
    robots = jax.jit(jax.vmap(one, (None, None, 0)))
    groups: dict[tuple[str, str], list[Lane]] = {}
    for lane in run.lanes_of(arguments.algo):
        groups.setdefault((lane.label, run.damage(lane)), []).append(lane)
    found: dict[str, list[tuple[Judged, np.ndarray]]] = {}
    rows: dict[str, tuple[Judged, np.ndarray]] = {}
    for (label, damage), lanes in groups.items():
        lanes = lanes[: arguments.seeds]
        keys = per_robot(lane_keys(lanes, "posterior"), 0, arguments.robots)
        parts = [
            jax.device_get(robots(learned(run, config, lane), damages.build(damage), own))
            for lane, own in zip(lanes, keys, strict=True)
        ]
        rows[f"{damage} {label}".strip()] = jax.tree.map(lambda *x: np.stack(x), *parts)
        found.setdefault(label, []).append(rows[f"{damage} {label}".strip()])
    rows |= {f"all {label}".strip(): jax.tree.map(lambda *x: np.concatenate(x), *own) for label, own in found.items()}
    show(rows, config)


def show(rows: dict[str, tuple[Judged, np.ndarray]], config: SRLConfig) -> None:
    """Prints both tables."""
    claimed, what = (3, "V") if config.values == "policy" else (1, "Q")
    names = ["pi_B better for", "states", "p > 1/2"]
    for length in ("a step", "a second", "good"):
        names += [length, "AUC of p"]
    verdicts = Table(*names, "calibration error", box=None)
    worths = Table(f"{what} of", box=None)
    for who in ("student", "pi_B"):
        for column in (f"{who}: 50 80 95 % cover", "std", "return less mean", "its std"):
            worths.add_column(column)
    for name, (judged, alive) in rows.items():
        verdicts.add_row(*verdict_row(name, judged, alive, claimed))
        worths.add_row(*worth_row(name, judged, alive, claimed))
    console = Console(width=150)
    console.print(verdicts)
    console.print(worths)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
