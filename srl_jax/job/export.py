"""What a run has learned, as policies that need neither the run nor jax."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np

from srl_jax import machine
from srl_jax.agents.settings import ActorConfig
from srl_jax.atlas.file import Atlas
from srl_jax.env.hexapod import ACTION_SCALE, CONTROL_HZ
from srl_jax.env.senses import layout
from srl_jax.job.students import Run, open_run
from srl_jax.portable import Layer, Policy
from srl_jax.program.lanes import Lane
from srl_jax.types import Params


def from_run(directory: Path, *, seed: int | None = None, algos: tuple[str, ...] = ()) -> list[Policy]:
    """The students of a finished run whose actors are networks.

    Args:
        directory: of the run.
        seed: only lanes of this seed; None: all.
        algos: only these algorithms; none: all that learn a network.

    Raises:
        ValueError: the run is not finished, has none of the algorithms or no such seed, or learns no network.
    """
    run = open_run(directory)
    learned = tuple(algo for algo in run.algos if isinstance(run.config.agent(algo), ActorConfig))
    for algo in algos:
        if algo in run.algos and algo not in learned:
            raise ValueError(f"algo is {algo!r}, which learns no network: export {', '.join(learned) or 'none'}.")
    lanes = [lane for algo in algos or learned for lane in run.lanes_of(algo)]
    if not lanes:
        raise ValueError(f"{directory} has no policy that is a network: its algorithms are {', '.join(run.algos)}.")
    chosen = [lane for lane in lanes if seed is None or lane.seed == seed]
    if not chosen:
        raise ValueError(
            f"seed is {seed}: {directory} has {', '.join(str(s) for s in sorted({x.seed for x in lanes}))}."
        )
    return [_student(run, lane) for lane in chosen]


def _student(run: Run, lane: Lane) -> Policy:
    env = run.config.env
    made = {"algo": lane.algo, "method": lane.method, "damage": run.damage(lane), "seed": lane.seed}
    facts = _facts(run.config.task, env.observation, run.robot.clock_hz, env.history)
    command = f"srl-jax run, {run.config.steps:,} steps of {lane.method}"
    about = made | facts | {"command": command, "versions": machine.versions()}
    return Policy(layers(run.learned(lane)["actor"]), about)


def from_atlas(atlas: Atlas) -> dict[str, Policy]:
    """The first policy that an atlas has for each damage."""
    facts = _facts(atlas.about["task"], atlas.about["observation"], atlas.about["clock_hz"])
    shared = facts | {name: atlas.about[name] for name in ("command", "versions")}
    found: dict[str, Policy] = {}
    for row, damage in enumerate(atlas.trained_for):
        own = jax.tree.map(lambda leaf, row=row: np.asarray(leaf[row]), atlas.actors)
        about = {"algo": "srl", "method": "srl", "damage": damage, "seed": 0} | shared
        found.setdefault(damage, Policy(layers(own), about))
    return found


def _facts(task: str, observation: str, clock_hz: float, history: int = 0) -> dict[str, Any]:
    return {
        "task": task,
        "kind": observation,
        "observation": layout(task, observation, history),
        "history": history,
        "action_scale": list(ACTION_SCALE) * 6,
        "clock_hz": float(clock_hz),
        "control_hz": CONTROL_HZ,
    }


def layers(actor: Params) -> tuple[Layer, ...]:
    """An actor's parameters (`agents.networks.Actor`) as plain arrays, from the observation to the action."""
    params: Mapping[str, Any] = actor["params"]
    torso = params.get("Torso_0", {})
    found = []
    for number in range(sum(name.startswith("Dense_") for name in torso)):
        dense, norm = torso[f"Dense_{number}"], torso.get(f"LayerNorm_{number}")
        own = (dense["kernel"], dense["bias"], *((norm["scale"], norm["bias"]) if norm else (None, None)))
        found.append(own)
    found.append((params["action"]["kernel"], params["action"]["bias"], None, None))
    plain = [[value if value is None else np.asarray(value, np.float32) for value in own] for own in found]
    return tuple(Layer(*own) for own in plain)
