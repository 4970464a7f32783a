"""Where pi_B comes from: the scripted gait, a healthy policy learned first, or the students of a finished run."""

import dataclasses
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax

from srl_jax import checkpoint, output, plan
from srl_jax import lanes as lane_table
from srl_jax.agents import behaviour as behaviours
from srl_jax.config import Config
from srl_jax.env import gait as gaits
from srl_jax.types import Params

STUDENTS = (
    "srl",
    "ddpg_warm",
    "ddpg",
    "acteach",
)  # whose students are taken from a finished run, first found


@dataclasses.dataclass(frozen=True)
class Behaviour:
    """pi_B: a function of (parameters, observation), and its parameters for every seed."""

    apply: Callable[[Params, jax.Array], jax.Array]
    params: Callable[[int], Params]  # seed -> parameters
    clock_hz: float
    network: bool = False  # whether an actor of the same architecture can start from its parameters


def scripted_gait() -> Behaviour:
    """The tuned tripod gait as pi_B, the same for every seed."""
    gait = gaits.load()
    frequency, gait = float(gait.frequency), gait._replace(frequency=None)  # the robot's clock has it
    return Behaviour(gaits.act, lambda seed: gait, frequency)


def check(config: Config) -> None:
    """Raises ValueError where `behaviour` names nothing usable."""
    if config.behaviour in ("gait", "train"):
        return
    directory = Path(config.behaviour)
    if not directory.is_dir():
        raise ValueError(f"behaviour is {config.behaviour!r}: give gait, train, or the directory of a finished run.")
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
    """The teachers of a run; a policy that is to be learned first is, in ``directory/behaviour``. None if stopped.

    Raises:
        ValueError: the finished run has no healthy lane to take pi_B from.
    """
    if config.behaviour == "gait":
        return (scripted_gait(),)
    path = Path(config.behaviour)
    if config.behaviour == "train":
        path = directory / "behaviour"
        if not (path / "summary.json").exists() and not _learn(config, path, devices, listener, stopped):
            return None
    return (from_run(path, config),)


def _learn(config: Config, path: Path, devices: int, listener: Callable, stopped: Callable[[], bool]) -> bool:
    """Learns a healthy policy per seed by SRL, guided by the gait; whether it finished."""
    from srl_jax import loop  # the loop loads teachers, one of which is made by a loop

    healthy = dataclasses.replace(config, behaviour="gait", algos="srl", damage="healthy", damage_schedule="")
    single = dataclasses.replace(healthy.srl, **{n: v[:1] for n, v in vars(healthy.srl).items() if _swept(v)})
    healthy = dataclasses.replace(healthy, srl=single)
    return bool(loop.run(healthy, path, devices, resume=path.exists(), listener=listener, stopped=stopped))


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

    def params(seed: int) -> Any:
        row = healthy.get(seed, healthy[seeds[seed % len(seeds)]])
        return jax.tree.map(lambda x: x[row], students)

    mine = getattr(config, plan.parse_algos(config.algos)[0])
    same = (agent.hidden, agent.layer_norm) == (mine.hidden, mine.layer_norm)
    apply = partial(behaviours.policy, config=agent)
    return Behaviour(apply, params, float(gaits.load().frequency), network=same)
