"""The field's benchmark of damage: each of six legs lost, and each of the fifteen pairs, walking straight ahead.

    python -m experiments.losses21 [finished runs of the same task and damages ...]

Trains what is missing in `--runs` (the damaged tripod, and intelligent trial and error on the shipped repertoire) by
the usual command line, then prints for every method: speed retained of a healthy reference, the share of robots that
recovered (no fall, at least half of that speed), and the robot time it took. Runs of SRL or DDPG with
``--task x --damage losses21`` may be added to the table. Every lane is judged by its last two evaluations, of equally
many episodes in all runs.
"""

import dataclasses
import itertools
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from srl_jax import statistics
from srl_jax.cli.ending import leave
from srl_jax.env.anatomy import LEGS
from srl_jax.env.damage_names import losses21
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.settings import EnvConfig
from srl_jax.ite import archive as repertoire
from srl_jax.report.data import RunData, read_metrics
from srl_jax.report.files import episodes, read_settings
from srl_jax.report.join import differences
from srl_jax.report.style import FIXED, PALETTE, STYLE
from srl_jax.report.summary import Scores, lane_scores

# Context from the literature: another robot and another simulator, the same 21 losses.
FIELD = "IT&E elsewhere (Mailer et al. 2021): .886 of healthy speed retained after 53 s of trials"
# One robot suffices for trials: 20 of 100 steps are over at 2,000, before the last two evaluations.
SHORT = {
    "steps": "3000",
    "evaluation.episodes": "10",
    "train.environments": "1",
    "train.evaluate-every": "500",
    "train.checkpoint-every": "1500",
    "train.physics-block": "60",
}
FROZEN = ("tripod", "pi_b")  # methods that take no time


@dataclass(frozen=True)
class Arguments:
    """Which runs, and where the results go."""

    others: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Finished runs to add."""
    runs: Path = Path("runs/losses21")
    """The run of tripod and ite; made where missing."""
    seeds: str = "10"
    out: Path = Path("docs/losses21.png")


def command(arguments: Arguments) -> list[str]:
    """The words after `python -m srl_jax.run` that make the run of tripod and ite, or go on with it."""
    if (arguments.runs / "config.json").exists():
        return ["--resume", str(arguments.runs)]
    words = ["--task", "x", "--damage", "losses21", "--algos", "tripod,ite", "--seeds", arguments.seeds]
    return [
        *words,
        *(word for name, value in SHORT.items() for word in (f"--{name}", value)),
        "--out",
        str(arguments.runs),
    ]


def train(arguments: Arguments) -> None:
    """Makes sure that the run of tripod and ite is there."""
    if not (arguments.runs / "summary.json").exists():
        words = ["-m", "srl_jax.run", *command(arguments)]
        if subprocess.run([sys.executable, *words]).returncode:
            raise ValueError(f"{' '.join(words)} did not finish: see what it said.")


def read(directory: Path) -> RunData:
    """A run of the benchmark.

    Raises:
        ValueError: the run is of another task or other damages, or has fewer than two evaluations after its start.
    """
    run = read_metrics(directory)
    found = {lane["damage"] for lane in run.lanes}
    if run.task != "x" or found != set(losses21()):
        raise ValueError(f"{directory} is of task {run.task} and {len(found)} damages: x and losses21 are needed.")
    evaluations = int((run.metrics["eval/distance"].steps > 0).sum()) if "eval/distance" in run.metrics else 0
    if evaluations < 2:
        raise ValueError(
            f"{directory} has {evaluations} evaluations after its start: lanes are judged by the last two."
        )
    return run


def rules(run: Path) -> dict[str, Any]:
    """By what a run is judged, or will be once it is made: episodes of an evaluation, and the environment."""
    if (run / "config.json").exists():
        settings = read_settings(run)
        return {"evaluation.episodes": episodes(settings), "env": settings["env"]}
    environment = json.loads(json.dumps(dataclasses.asdict(EnvConfig())))  # lists for tuples, as in a file
    return {"evaluation.episodes": int(SHORT["evaluation.episodes"]), "env": environment}


def check(first: Path, others: Sequence[Path]) -> None:
    """Raises ValueError where a run is judged otherwise than the first."""
    for other in others:
        if changed := differences(rules(first), rules(other)):
            raise ValueError(f"{other} was judged otherwise than {first}: they differ in {', '.join(changed)}.")


def scores(run: RunData, directory: Path) -> dict[str, Scores]:
    """Per method its lanes' scores [seeds, 21 losses], with the robot `seconds` it took.

    Raises:
        ValueError: a search does not say how long its trials took, or a method lacks a healthy reference.
    """
    methods: dict[str, Scores] = {}
    taught = "" if run.config["behaviour"] == "gait" else f"by {run.config['behaviour']}"
    for group in run.groups:
        order = [run.damages(group).index(damage) for damage in losses21()]
        found = {name: values[:, order] for name, values in lane_scores(run, group).items()}
        if group.algo == "ite":
            if "gauge_trial_seconds" not in found:
                raise ValueError(f"{directory} has no gauge/trial_seconds for {group.label}: train it anew.")
            found |= {"seconds": found["gauge_trial_seconds"], "retained_own": found["distance"] / best_of_map()}
        else:
            learning = 0.0 if group.algo in FROZEN else run.config["steps"] / CONTROL_HZ
            found["seconds"] = np.full_like(found["distance"], learning)
        if missing := {"distance", "fell", "retained", "retained_own"} - found.keys():
            raise ValueError(f"{directory} lacks what {', '.join(sorted(missing))} of {group.label} is made of.")
        methods[" ".join(filter(None, (group.label, taught)))] = found
    return methods


def best_of_map() -> float:
    """Distance (m) of the best gait of the shipped repertoire on the healthy robot: the own reference of `ite`."""
    return float(repertoire.load().fitness.max())


def cell(values: np.ndarray, statistic: Callable = statistics.iqm) -> str:
    low, high = statistics.stratified_interval(values, statistic)
    return f"{statistic(values):.2f} [{low:.2f}, {high:.2f}]"


def summarise(methods: dict[str, Scores], seconds: float) -> Table:
    """One row per method; interquartile means over seeds x damages with 95 % stratified bootstrap intervals.

    What is retained with one leg lost, and with two, are plain means of the common retention.

    Args:
        methods: name -> scores.
        seconds: of an episode.
    """
    names = ("method", "speed m/s", "retained (common)", "retained (own)", "one leg, two", "recovered", "robot time s")
    table = Table(*names, box=None)
    for name, found in methods.items():
        recovered = ((found["fell"] == 0.0) & (found["retained"] >= 0.5)).astype(float)
        parts = np.split(found["retained"], [len(LEGS)], axis=1)  # one leg lost, and two
        table.add_row(
            name,
            *map(cell, (found["distance"] / seconds, found["retained"], found["retained_own"])),
            ", ".join(f"{part.mean():.2f}" for part in parts),
            cell(recovered, np.mean),
            f"{found['seconds'].mean():.0f}",
        )
    return table


def draw(methods: dict[str, Scores], path: Path) -> None:
    """Retained speed of every damage: the mean over seeds as bars with its standard deviation, one group a damage."""
    free = itertools.cycle(colour for colour in PALETTE if colour not in FIXED.values())
    width = 0.8 / len(methods)
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(12, 3.6), layout="constrained")
        axes = figure.subplots()
        for index, (name, found) in enumerate(methods.items()):
            values = found["retained"]
            places = np.arange(values.shape[1]) + (index - 0.5 * (len(methods) - 1)) * width
            look: Any = {"color": FIXED.get(name) or next(free), "error_kw": {"lw": 0.8, "ecolor": "#444444"}}
            axes.bar(places, values.mean(0), width, yerr=values.std(0), label=name, **look)
        axes.axhline(1.0, color="0.5", ls=":", lw=1)
        axes.set_xticks(np.arange(21), [name.replace("leg_", "").replace("+", "\n") for name in losses21()], fontsize=8)
        axes.set(xlabel="legs lost", ylabel="speed, of healthy tripod")
        axes.legend(frameon=False, ncols=len(methods))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def together(runs: dict[Path, RunData]) -> dict[str, Scores]:
    """The methods of all runs; a name that occurs again is told apart by its directory."""
    methods: dict[str, Scores] = {}
    for path, run in runs.items():
        found = scores(run, path)
        methods |= {f"{name}, {path.name}" if name in methods else name: x for name, x in found.items()}
    return methods


def main(arguments: Arguments) -> None:
    """Trains, prints the table, draws the figure."""
    others = {directory: read(directory) for directory in arguments.others}
    check(arguments.runs, arguments.others)  # before anything long
    train(arguments)
    runs = {arguments.runs: read(arguments.runs), **others}
    methods = together(runs)
    own, seconds = methods["tripod"], runs[arguments.runs].config["env"]["episode_steps"] / CONTROL_HZ
    reference = own.get("reference_distance", own["healthy_distance"]).mean() / seconds
    console = Console(width=140)
    console.print(f"21 losses x {len(own['fell'])} seeds; healthy tripod {reference:.3f} m/s")
    console.print(summarise(methods, seconds))
    console.print(FIELD)
    draw(methods, arguments.out)


if __name__ == "__main__":
    leave(main, tyro.cli(Arguments))
