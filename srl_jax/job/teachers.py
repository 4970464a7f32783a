"""Where pi_B comes from, and its fellow teachers: the scripted gait, what is learned or tried first, a finished run."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour as behaviours
from srl_jax.agents.settings import ActorConfig
from srl_jax.agents.sweep import first_values
from srl_jax.config import Config
from srl_jax.env import damage_names
from srl_jax.env import gait as gaits
from srl_jax.env.anatomy import PHANTOMX, Anatomy
from srl_jax.job import atlas_teacher, checkpoint, files
from srl_jax.job.plan import make, parse_algos, parse_teachers
from srl_jax.program.lanes import Lane
from srl_jax.types import Params

# Whose students are taken from a finished run, first found.
STUDENTS = ("srl", "ddpg_warm", "ddpg", "acteach", "rlpd", "ibrl", "jsrl")
RunJob = Callable[[Config, Path], bool]  # trains what a configuration says into a directory; whether it finished


@dataclasses.dataclass(frozen=True)
class Behaviour:
    """pi_B, or one of several: a function of (parameters, observation), and its parameters for every lane."""

    apply: Callable[[Params, jax.Array], jax.Array]
    params: Callable[[Sequence[Lane]], Params]  # of n lanes, leaves [n, ...]
    clock_hz: float
    architecture: Any = None  # of actors that can start from its parameters; None: from a clone


def scripted_gait(anatomy: Anatomy = PHANTOMX) -> Behaviour:
    """A robot's tuned gait as pi_B, the same for every lane."""
    gait = gaits.load(anatomy)
    frequency, gait = float(gait.frequency), gait._replace(frequency=None)  # the robot's clock has it

    def params(lanes: Sequence[Lane]) -> Params:
        return jax.tree.map(lambda x: jnp.full(len(lanes), x), gait)

    return Behaviour(gaits.walker(anatomy), params, frequency)


def check(config: Config) -> None:
    """Raises ValueError where `behaviour` names nothing usable."""
    wanted = parse_teachers(config)
    if len(set(wanted)) < len(wanted):
        raise ValueError(f"behaviour is {config.behaviour!r}: name each teacher once.")
    for field in ("damage_schedule", "damage_mix"):
        if "repertoire" in wanted and getattr(config, field):
            raise ValueError(
                f"behaviour repertoire tries gaits on one damage and does not go with {field}; leave one out."
            )
    if "repertoire" in wanted or "ite" in parse_algos(config.algos):
        if config.anatomy != PHANTOMX:
            raise ValueError(
                f"robot is {config.robot!r}: ite and its repertoire are the {PHANTOMX.name}'s; leave them out."
            )
        from srl_jax.ite.agent import prior_map

        prior_map(config.ite.repertoire)
    for name in wanted:
        if MADE.get(name):
            make(MADE[name](config))
        elif atlas_teacher.named(name):
            atlas_teacher.load(name, config)
        elif name not in MADE:
            _check_run(Path(name), config)


def _check_run(directory: Path, config: Config) -> None:
    if not directory.is_dir():
        raise ValueError(
            f"behaviour is {str(directory)!r}: give {', '.join((*MADE, *atlas_teacher.KINDS))}, or the directory of a "
            "finished run."
        )
    stored, _ = files.read_config(directory)
    for name, mine, theirs in (
        ("robot", config.robot, stored.robot),
        ("task", config.task, stored.task),
        ("env.observation", config.env.observation, stored.env.observation),
        ("env.history", config.env.history, stored.env.history),
    ):
        if mine != theirs:
            raise ValueError(f"behaviour {directory} was trained with {name}={theirs}, this run has {name}={mine}.")


def load(config: Config, directory: Path, train: RunJob) -> tuple[Behaviour, ...] | None:
    """The teachers of a run; those that are to be made first are, each in a folder of its own. None if stopped.

    Args:
        config: of the run.
        directory: its own.
        train: does the run that makes a teacher.

    Raises:
        ValueError: the finished run has no healthy lane to take pi_B from, or is not finished.
    """
    teachers = []
    for name in parse_teachers(config):
        if name == "gait":
            teachers.append(scripted_gait(config.anatomy))
            continue
        if atlas_teacher.named(name):
            teachers.append(from_atlas(name, config))
            continue
        path, made = Path(name), MADE.get(name)
        if made:
            path = directory / ("behaviour" if name == "train" else name)
            if not (path / "summary.json").exists() and not train(made(config), path):
                return None
        teachers.append(from_trials(path) if name == "repertoire" else from_run(path))
    return tuple(teachers)


def _healthy_run(config: Config) -> Config:
    """Learns a healthy policy per seed by SRL, guided by the gait."""
    healthy = dataclasses.replace(config, behaviour="gait", algos="srl", damage="healthy", part="")
    healthy = dataclasses.replace(healthy, damage_schedule="", damage_mix="")
    return dataclasses.replace(healthy, srl=first_values(healthy.srl))


def _trial_run(config: Config) -> Config:
    """Tries gaits of the repertoire on every lane's damage, straight ahead, which is what its gaits do."""
    steps = config.ite.trials * config.env.episode_steps * config.train.environments
    every = dict(evaluate_every=steps, checkpoint_every=steps, warmup=steps)
    train = dataclasses.replace(config.train, **every)
    damage = config.damage if config.damage != "task" else ",".join(damage_names.task_set(config.task))
    walk = dict(behaviour="gait", algos="ite", task="x", damage=damage, part="")
    return dataclasses.replace(config, **walk, steps=steps, train=train)


MADE = {"gait": None, "train": _healthy_run, "repertoire": _trial_run}  # teachers that need no finished run


def from_run(path: Path) -> Behaviour:
    """The students of a finished run's healthy lanes as pi_B, one per seed (taken in turn if there are fewer)."""
    stored, _ = files.read_config(path)
    lanes = make(stored).lanes
    algo = next((a for a in STUDENTS if any(lane.algo == a and lane.damage == "healthy" for lane in lanes)), None)
    if algo is None:
        raise ValueError(f"behaviour {path} has no healthy lane: pi_B is taken from a run with --damage healthy.")
    networks, place = checkpoint.learned(path, lanes)[algo]
    found = [lane for lane in lanes if lane.algo == algo and lane.damage == damage_names.HEALTHY]
    healthy = {lane.seed: place[lane.index] for lane in reversed(found)}
    rows = [healthy[seed] for seed in sorted(healthy)]
    agent = cast(ActorConfig, stored.agent(algo))

    def params(lanes: Sequence[Lane]) -> Params:
        index = np.array([healthy.get(lane.seed, rows[lane.seed % len(rows)]) for lane in lanes])
        return jax.tree.map(lambda x: x[index], networks["actor"])

    apply = partial(behaviours.policy, config=agent)
    return Behaviour(apply, params, float(gaits.load(stored.anatomy).frequency), agent.architecture)


def from_trials(path: Path) -> Behaviour:
    """What every lane's robot found in a repertoire after its damage, by a finished run of `ite`."""
    from srl_jax.ite import agent

    stored, _ = files.read_config(path)
    lanes = make(stored).lanes
    networks, place = checkpoint.learned(path, lanes)["ite"]
    found = {(lane.seed, lane.damage): place[lane.index] for lane in lanes}

    def params(lanes: Sequence[Lane]) -> Params:
        index = np.array([found[lane.seed, lane.damage] for lane in lanes])
        return jax.tree.map(lambda x: x[index], networks["actor"])

    return Behaviour(agent.policy, params, float(gaits.load().frequency))


def from_atlas(name: str, config: Config) -> Behaviour:
    """For every lane the policy of an atlas that is best under its damage; errors as `atlas_teacher.load`."""
    atlas = atlas_teacher.load(name, config)
    choose = cache(partial(atlas_teacher.best, name, atlas))

    def params(lanes: Sequence[Lane]) -> Params:
        index = np.array([choose(lane.damage) for lane in lanes])
        return jax.tree.map(lambda leaf: leaf[index], atlas.actors)

    apply = partial(behaviours.policy, config=atlas.network)
    return Behaviour(apply, params, float(atlas.about["clock_hz"]), atlas.network.architecture)
