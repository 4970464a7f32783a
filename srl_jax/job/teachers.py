"""Where pi_B comes from, and its fellow teachers: the scripted gait, what is learned or tried first, a finished run."""

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax

from srl_jax.agents import behaviour as behaviours
from srl_jax.config import Config
from srl_jax.env import damage_names
from srl_jax.env import gait as gaits
from srl_jax.job import checkpoint, plan
from srl_jax.job import files as output
from srl_jax.program import lanes as lane_table
from srl_jax.program.lanes import Lane
from srl_jax.types import Params

STUDENTS = ("srl", "ddpg_warm", "ddpg", "acteach")  # whose students are taken from a finished run, first found


@dataclasses.dataclass(frozen=True)
class Behaviour:
    """pi_B, or one of several: a function of (parameters, observation), and its parameters for every lane."""

    apply: Callable[[Params, jax.Array], jax.Array]
    params: Callable[[Lane], Params]
    clock_hz: float
    network: bool = False  # whether an actor of the same architecture can start from its parameters


def scripted_gait() -> Behaviour:
    """The tuned tripod gait as pi_B, the same for every lane."""
    gait = gaits.load()
    frequency, gait = float(gait.frequency), gait._replace(frequency=None)  # the robot's clock has it
    return Behaviour(gaits.act, lambda lane: gait, frequency)


def names(config: Config) -> list[str]:
    """The teachers that a configuration asks for, in order; the first is pi_B."""
    return [name.strip() for name in config.behaviour.split(",")]


def check(config: Config) -> None:
    """Raises ValueError where `behaviour` names nothing usable."""
    wanted = names(config)
    if len(set(wanted)) < len(wanted):
        raise ValueError(f"behaviour is {config.behaviour!r}: name each teacher once.")
    if "repertoire" in wanted and config.damage_schedule:
        raise ValueError(
            "behaviour repertoire tries gaits on one damage and does not go with damage_schedule; leave one out."
        )
    if "repertoire" in wanted or "ite" in plan.parse_algos(config.algos):
        from srl_jax.ite.agent import prior_map

        prior_map(config.ite.repertoire)
    for name in wanted:
        if name not in MADE:
            _check_run(Path(name), config)


def _check_run(directory: Path, config: Config) -> None:
    if not directory.is_dir():
        raise ValueError(
            f"behaviour is {str(directory)!r}: give {', '.join(MADE)}, or the directory of a finished run."
        )
    stored, _ = output.read_config(directory)
    for name, mine, theirs in (
        ("task", config.task, stored.task),
        ("env.observation", config.env.observation, stored.env.observation),
    ):
        if mine != theirs:
            raise ValueError(f"behaviour {directory} was trained with {name}={theirs}, this run has {name}={mine}.")


def load(
    config: Config, directory: Path, devices: int, *, listener: Callable, stopped: Callable[[], bool]
) -> tuple[Behaviour, ...] | None:
    """The teachers of a run; those that are to be made first are, each in a folder of its own. None if stopped.

    Raises:
        ValueError: the finished run has no healthy lane to take pi_B from.
    """
    teachers = []
    for name in names(config):
        if name == "gait":
            teachers.append(scripted_gait())
            continue
        path, make = Path(name), MADE.get(name)
        if make:
            path = directory / ("behaviour" if name == "train" else name)
            unfinished = not (path / "summary.json").exists()
            if unfinished and not _run(make(config), path, devices, listener, stopped):
                return None
        teachers.append(from_trials(path) if name == "repertoire" else from_run(path, config))
    return tuple(teachers)


def _run(config: Config, path: Path, devices: int, listener: Callable, stopped: Callable[[], bool]) -> bool:
    """Does the run that makes a teacher; whether it finished."""
    from srl_jax import loop  # the loop loads teachers, some of which are made by a loop

    return bool(loop.run(config, path, devices, resume=path.exists(), listener=listener, stopped=stopped))


def _healthy_run(config: Config) -> Config:
    """Learns a healthy policy per seed by SRL, guided by the gait."""
    healthy = dataclasses.replace(config, behaviour="gait", algos="srl", damage="healthy", damage_schedule="")
    single = dataclasses.replace(healthy.srl, **{n: v[:1] for n, v in vars(healthy.srl).items() if _swept(v)})
    return dataclasses.replace(healthy, srl=single)


def _trial_run(config: Config) -> Config:
    """Tries gaits of the repertoire on every lane's damage, straight ahead, which is what its gaits do."""
    steps = config.ite.trials * config.env.episode_steps * config.train.environments
    every = dict(evaluate_every=steps, checkpoint_every=steps, warmup=steps)
    train = dataclasses.replace(config.train, **every)
    damage = config.damage if config.damage != "task" else ",".join(damage_names.parse_names("task", config.task))
    return dataclasses.replace(config, behaviour="gait", algos="ite", task="x", damage=damage, steps=steps, train=train)


MADE = {"gait": None, "train": _healthy_run, "repertoire": _trial_run}  # teachers that need no finished run


def _swept(value: Any) -> bool:
    return isinstance(value, tuple) and len(value) > 1 and all(isinstance(v, float) for v in value)


def from_run(path: Path, config: Config) -> Behaviour:
    """The students of a finished run's healthy lanes as pi_B, one per seed (taken in turn if there are fewer)."""
    stored, devices = output.read_config(path)
    lanes = plan.make(stored).lanes
    algo = next((a for a in STUDENTS if any(lane.algo == a and lane.damage == "healthy" for lane in lanes)), None)
    if algo is None:
        raise ValueError(f"behaviour {path} has no healthy lane: pi_B is taken from a run with --damage healthy.")
    students = checkpoint.students(path / "checkpoints")[algo]
    rows = lane_table.lay_out(lanes, devices).of(algo)
    healthy = {lane.seed: i for i, lane in reversed(list(enumerate(rows))) if lane.damage == "healthy"}
    seeds = sorted(healthy)
    agent = getattr(stored, algo)

    def params(lane: Lane) -> Any:
        row = healthy.get(lane.seed, healthy[seeds[lane.seed % len(seeds)]])
        return jax.tree.map(lambda x: x[row], students)

    mine = getattr(config, plan.parse_algos(config.algos)[0])
    shape = lambda agent: (getattr(agent, "hidden", None), getattr(agent, "layer_norm", None))  # noqa: E731
    apply = partial(behaviours.policy, config=agent)
    return Behaviour(apply, params, float(gaits.load().frequency), network=shape(agent) == shape(mine))


def from_trials(path: Path) -> Behaviour:
    """What every lane's robot found in a repertoire after its damage, by a finished run of `ite`."""
    from srl_jax.ite import agent

    stored, devices = output.read_config(path)
    rows = lane_table.lay_out(plan.make(stored).lanes, devices).of("ite")
    students = checkpoint.students(path / "checkpoints")["ite"]
    found = {(lane.seed, lane.damage): row for row, lane in enumerate(rows)}

    def params(lane: Lane) -> Any:
        return jax.tree.map(lambda x: x[found[lane.seed, lane.damage]], students)

    return Behaviour(agent.policy, params, float(gaits.load().frequency))
