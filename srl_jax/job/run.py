"""A run from its configuration to its files: accepted, claimed, taught, trained in one wave or several, summed up."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from srl_jax.config import Config
from srl_jax.env.model import load_model
from srl_jax.job import checkpoint, files, memory, page, tables, teachers
from srl_jax.job import plan as plans
from srl_jax.job.loop import Loop
from srl_jax.job.plan import Plan
from srl_jax.job.progress import Listener, Progress, together
from srl_jax.program.lanes import Lane
from srl_jax.report.curves import save_curves
from srl_jax.report.data import read_metrics
from srl_jax.report.summary import summarise


def run(
    config: Config,
    directory: Path,
    devices: int,
    *,
    exact: bool = True,
    resume: bool = False,
    listener: Listener = lambda progress: None,
    stopped: Callable[[], bool] = lambda: False,
) -> dict[str, Any] | None:
    """Trains every lane of a configuration and leaves the files of a run.

    Args:
        config: what to do.
        directory: where the files go; new, or of a run to resume.
        devices: over how many devices lanes are laid.
        exact: whether it must be this directory, or another number may be appended where it is taken.
        resume: go on from the newest checkpoint in `directory`.
        listener: called now and then with the progress.
        stopped: asked now and then; once True, the run saves its state and returns.

    Returns:
        The summary that was written, or None where the run was stopped (resume it).

    Raises:
        ValueError: the configuration, the directory or a checkpoint is unusable; nothing has been written then.
    """
    plan = plans.make(config)
    waves = memory.waves(config, plan.lanes, devices)
    teachers.check(config)
    load_model(config.anatomy)  # which says what its description lacks, while nothing is written yet
    if not resume:
        directory = files.claim(directory, exact=exact)
    with files.in_use(directory):
        files.write_config(directory, config, devices, checkpoint.newest(directory / "checkpoints"))
        tables.write_lanes(directory, plan.lanes)
        note = memory.describe(config, waves, devices)
        listener(Progress(directory, "planning", 0, config.steps, 0.0, 0.0, 0.0, {}, note))

        def sub_run(config: Config, path: Path) -> bool:
            return bool(run(config, path, devices, resume=path.exists(), listener=listener, stopped=stopped))

        taught = teachers.load(config, directory, sub_run)
        if taught is None:
            return None
        loop = _maker(config, plan, devices, taught, listener, stopped)
        whole = len(waves) == 1
        summary = loop(plan.lanes, directory).go() if whole else _in_waves(config, directory, devices, waves, loop)
        if summary is not None and (note := page.leave(directory)):
            listener(Progress(directory, "summary", config.steps, config.steps, 0.0, 0.0, 0.0, {}, note))
        return summary


def _maker(config: Config, plan: Plan, devices: int, taught, listener: Listener, stopped) -> Callable[..., Loop]:
    def make(lanes: Sequence[Lane], directory: Path) -> Loop:
        room = plan.room if len(lanes) == len(plan.lanes) else {}
        return Loop(config, replace(plan, lanes=lanes, room=room), directory, devices, taught, listener, stopped)

    return make


def _in_waves(
    config: Config, directory: Path, devices: int, waves: Sequence[Sequence[Lane]], loop: Callable[..., Loop]
) -> dict[str, Any] | None:
    """Trains one part of the lanes after the other, each in a folder of its own, and joins what they measured."""
    folders, machines = [directory / f"wave-{number}" for number in range(1, 1 + len(waves))], []
    for lanes, folder in zip(waves, folders, strict=True):
        if not (folder / "summary.json").exists():
            folder.mkdir(exist_ok=True)
            files.write_config(folder, config, devices, checkpoint.newest(folder / "checkpoints"))
            tables.write_lanes(folder, lanes)
            if loop(lanes, folder).go() is None:
                return None
        machines.append(json.loads((folder / "summary.json").read_text())["machine"])
    tables.join_metrics([(folder, 0) for folder in folders], directory)
    data = read_metrics(directory)
    summary = summarise(data) | {"machine": together(machines) | {"waves": len(machines)}}
    files.write_json(directory / "summary.json", summary)
    save_curves(data, directory / "curves.png")
    return summary
