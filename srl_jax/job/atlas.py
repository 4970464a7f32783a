"""An atlas from a finished run: its students on every damage, and how the senses tell the damages apart."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax import machine
from srl_jax.agents.settings import ActorConfig
from srl_jax.atlas import file, fit, matrix
from srl_jax.atlas.file import Atlas
from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.env import gait as gaits
from srl_jax.env.anatomy import PHANTOMX
from srl_jax.job import students

WALKS, STEPS = 4, 100  # of every pair of policy and damage; control steps that count
STREAM = 7  # of the starts, apart from training's


def from_run(directory: Path, out: Path, *, command: str = "") -> Atlas:
    """Judges every student of a run under every damage of it, and writes the atlas.

    Args:
        directory: of a finished run whose damages include the healthy robot.
        out: the file.
        command: that makes it again, for the record.

    Raises:
        ValueError: the run has no healthy lane, sees what no robot senses or a history, is not finished, or is of
            another robot than the PhantomX.
    """
    run = students.open_run(directory)
    if run.robot.anatomy != PHANTOMX:
        raise ValueError(f"{directory} was trained with robot={run.config.robot}: an atlas is the {PHANTOMX.name}'s.")
    lanes = [lane for algo in run.algos[:1] for lane in run.lanes_of(algo)]
    names = tuple(dict.fromkeys([damage_names.HEALTHY, *(lane.damage for lane in lanes)]))
    if not any(lane.damage == damage_names.HEALTHY for lane in lanes):
        raise ValueError(f"{directory} has no healthy lane: an atlas needs one, --damages healthy,...")
    if run.config.env.observation == "full":
        raise ValueError(
            f"{directory} was trained with env.observation=full, which no robot senses; use onboard or rates."
        )
    lanes.sort(key=lambda lane: (names.index(lane.damage), lane.seed))
    learned = [run.learned(lane)["actor"] for lane in lanes]
    actors = jax.tree.map(lambda *leaves: jnp.stack(leaves), *learned)
    if run.config.env.history:
        raise ValueError(
            f"{directory} was trained with env.history={run.config.env.history}; an atlas' policies see none."
        )
    agent = run.config.agent(run.algos[0])
    assert isinstance(agent, ActorConfig)
    walked = matrix.measure(
        run.robot, actors, damages.stack(names), jax.random.key(STREAM), config=agent, walks=WALKS, steps=STEPS
    )
    walkers = {lane.damage: actor for lane, actor in zip(reversed(lanes), reversed(learned), strict=True)}
    about = {
        "task": run.config.task,
        "observation": run.config.env.observation,
        "clock_hz": float(gaits.load().frequency),
        "hidden": list(agent.hidden),
        "layer_norm": agent.layer_norm,
        "steps": run.config.steps,
        "command": command,
        "versions": machine.versions(),
    }
    atlas = Atlas(
        damages=names,
        trained_for=tuple(lane.damage for lane in lanes),
        actors=jax.tree.map(np.asarray, actors),
        speed=walked.speed,
        falls=walked.falls,
        whitening=fit.whitening(run.robot, names, walkers, agent, seed=STREAM),
        about=about,
    )
    file.save(out, atlas)
    return atlas
