"""The field's benchmark of damage: each of six legs lost, and each of the fifteen pairs, walking straight ahead.

    python -m experiments.losses21 [finished runs of the same task and damages ...]

Trains what is missing in `--runs` (the damaged tripod, and intelligent trial and error on the shipped repertoire) by
the usual command line, then prints for every method: speed retained of a healthy reference, the share of robots that
recovered (no fall, at least half of that speed), and the robot time it took. Runs of SRL or DDPG with
``--task x --damage losses21`` may be added to the table.
"""

import csv
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from matplotlib import rc_context
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from srl_jax import statistics
from srl_jax.cli.ending import leave
from srl_jax.env.damage_names import losses21
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.model import LEGS
from srl_jax.ite import archive as repertoire
from srl_jax.job import files as output
from srl_jax.report.style import FIXED, PALETTE, STYLE

# Context from the literature: another robot and another simulator, the same 21 losses.
FIELD = "IT&E elsewhere (Mailer et al. 2021): .886 of healthy speed retained after 53 s of trials"
SHORT = {"environments": "4", "evaluate-every": "2000", "checkpoint-every": "8000"}
Scores = dict[str, np.ndarray]  # [seeds, damages]


@dataclass(frozen=True)
class Arguments:
    """Which runs, and where the results go."""

    others: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """Finished runs to add."""
    runs: Path = Path("runs/losses21")
    """The run of tripod and ite; made where missing."""
    seeds: str = "10"
    out: Path = Path("docs/losses21.png")


def train(arguments: Arguments) -> None:
    """Makes sure that the run of tripod and ite is there."""
    if (arguments.runs / "summary.json").exists():
        return
    command = [sys.executable, "-m", "srl_jax.run", "--task", "x", "--damage", "losses21", "--algos", "tripod,ite"]
    command += ["--seeds", arguments.seeds, "--steps", "8000", "--out", str(arguments.runs)]
    command += [word for name, value in SHORT.items() for word in (f"--train.{name}", value)]
    if (arguments.runs / "config.json").exists():
        command = [sys.executable, "-m", "srl_jax.run", "--resume", str(arguments.runs)]
    if subprocess.run(command).returncode:
        raise SystemExit(f"losses21: {' '.join(command[1:])} did not finish.")


def read(directory: Path) -> tuple[dict[str, Scores], float]:
    """Per method the last value of every metric, and the healthy tripod's or pi_B's distance (m).

    Raises:
        ValueError: the run is of another task or other damages.
    """
    config, _ = output.read_config(directory)
    lanes = list(csv.DictReader((directory / "lanes.csv").open()))
    found = list(dict.fromkeys(lane["damage"] for lane in lanes))
    if config.task != "x" or set(found) != set(losses21()):
        raise ValueError(f"{directory} is of task {config.task} and {len(found)} damages: x and losses21 are needed.")
    last: dict[tuple[str, int], tuple[int, float]] = {}
    for row in csv.DictReader((directory / "metrics.csv").open()):
        key, step = (row["metric"], int(row["lane"])), int(row["step"])
        if step >= last.get(key, (-1, 0.0))[0]:
            last[key] = (step, float(row["value"]))
    seeds = sorted({int(lane["seed"]) for lane in lanes})
    methods: dict[str, Scores] = defaultdict(dict)
    for metric in ("eval/distance", "eval/fell", "healthy/distance", "train/trial_seconds"):
        for lane in lanes:
            if (metric, int(lane["lane"])) in last:
                taught = "" if config.behaviour == "gait" else f"by {config.behaviour}"
                name = " ".join(filter(None, (lane["algo"], lane["variant"], taught)))
                table = methods[name].setdefault(metric, np.full((len(seeds), len(found)), np.nan))
                place = seeds.index(int(lane["seed"])), losses21().index(lane["damage"])
                table[place] = last[metric, int(lane["lane"])][1]
    for name, scores in methods.items():
        learning = 0.0 if name in ("tripod", "pi_b") else config.steps / CONTROL_HZ
        seconds = scores.get("train/trial_seconds", learning)
        scores["seconds"] = np.broadcast_to(seconds, scores["eval/distance"].shape)
    return dict(methods), config.env.episode_steps / CONTROL_HZ


def best_of_map() -> float:
    """Distance (m) of the best gait of the shipped repertoire on the healthy robot: the own reference of `ite`."""
    return float(repertoire.load().fitness.max())


def cell(values: np.ndarray, statistic: Callable = statistics.iqm) -> str:
    low, high = statistics.stratified_interval(values, statistic)
    return f"{statistic(values):.2f} [{low:.2f}, {high:.2f}]"


def summarise(methods: dict[str, Scores], reference: float, seconds: float) -> Table:
    """One row per method; interquartile means over seeds x damages with 95 % stratified bootstrap intervals.

    What is retained with one leg lost, and with two, are plain means of the common retention.
    """
    names = ("method", "speed m/s", "retained (common)", "retained (own)", "one leg, two", "recovered", "robot time s")
    table = Table(*names, box=None)
    for name, scores in methods.items():
        distance, fell = scores["eval/distance"], scores["eval/fell"]
        own = best_of_map() if name.startswith("ite") else scores["healthy/distance"].mean()
        recovered = ((fell == 0.0) & (distance >= 0.5 * reference)).astype(float)
        cells = [cell(distance / unit) for unit in (seconds, reference, own)]
        parts = np.split(distance / reference, [len(LEGS)], axis=1)  # one leg lost, and two
        cells.append(", ".join(f"{part.mean():.2f}" for part in parts))
        table.add_row(name, *cells, cell(recovered, np.mean), f"{np.mean(scores['seconds']):.0f}")
    return table


def draw(methods: dict[str, Scores], reference: float, path: Path) -> None:
    """Retained speed of every damage: the mean over seeds as bars with its standard deviation, one group a damage."""
    free = (colour for colour in PALETTE if colour not in FIXED.values())
    width = 0.8 / len(methods)
    with rc_context(STYLE | {"axes.grid": False}):
        figure = Figure(figsize=(12, 3.6), layout="constrained")
        axes = figure.subplots()
        for index, (name, scores) in enumerate(methods.items()):
            values = scores["eval/distance"] / reference
            places = np.arange(values.shape[1]) + (index - 0.5 * (len(methods) - 1)) * width
            look = {"color": FIXED.get(name) or next(free), "error_kw": {"lw": 0.8, "ecolor": "#444444"}}
            axes.bar(places, values.mean(0), width, yerr=values.std(0), label=name, **look)
        axes.axhline(1.0, color="0.5", ls=":", lw=1)
        axes.set_xticks(np.arange(21), [name.replace("leg_", "").replace("+", "\n") for name in losses21()], fontsize=8)
        axes.set(xlabel="legs lost", ylabel="speed, of healthy tripod")
        axes.legend(frameon=False, ncols=len(methods))
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=150)


def main() -> None:
    """Trains, prints the table, draws the figure."""
    arguments = tyro.cli(Arguments)
    others = [read(directory)[0] for directory in arguments.others]  # before anything long
    train(arguments)
    methods, seconds = read(arguments.runs)
    reference = float(methods["tripod"]["healthy/distance"].mean())
    for directory, found in zip(arguments.others, others, strict=True):
        methods |= {f"{name}, {directory.name}" if name in methods else name: x for name, x in found.items()}
    console = Console(width=140)
    console.print(
        f"21 losses x {len(methods['tripod']['eval/fell'])} seeds; healthy tripod {reference / seconds:.3f} m/s"
    )
    console.print(summarise(methods, reference, seconds))
    console.print(FIELD)
    draw(methods, reference, arguments.out)


if __name__ == "__main__":
    leave(main)
