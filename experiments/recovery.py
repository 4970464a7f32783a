"""How soon a robot walks on after its damage: speed kept, falls and what it finds out, from the moment it strikes.

    python -m experiments.recovery srl_jax/atlas/atlas.npz --rows foreseen left-out --figure recovery.png

Robots are C MuJoCo at 2 ms and 50 iterations on another floor, with noisy sensors; the damage strikes in mid-stride and
robot time counts from there. Speeds are shares of what the healthy robot walks in the same world under the scripted
tripod; recovered is no fall, and half of that in the last window. Rows are what robots go through
(`experiments/recovering/rows.py`), methods how they go on (`methods.py`).
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.recovering import figure, generalists, scores, timing
from experiments.recovering.methods import METHODS, scopes
from experiments.recovering.rows import ROWS, Case, cases
from srl_jax.atlas import file, recovery
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.robots import ROBOTS, CRobot
from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.env import gait as gaits
from srl_jax.env.senses import observation
from srl_jax.job.apprentice import Apprentice

Walk = Callable[[Sequence[Case], Sequence[CRobot], float], recovery.Story | str]  # or what is to be said in its place
HZ = 20
STRIKE = (20, 40)  # control steps of healthy walking before the damage
WINDOWS = ((0.0, 1.0), (2.0, 7.0), (5.0, 10.0))  # seconds after the damage over which speed is taken
STANDARD = 140  # control steps by which the healthy speed is taken
RECOVERED = 0.5  # share of the healthy speed, without a fall
LOOKS = (0.2, 0.5, 1.0, 2.0)  # seconds after the damage at which the posterior is read


@dataclass(frozen=True)
class Args:
    """Damages every robot in mid-stride, and measures how it goes on."""

    atlas: tyro.conf.Positional[Path]
    rows: tuple[str, ...] = ("foreseen", "left-out")
    """Of foreseen, catalogue, left-out, pairs, triples, faults, kinds, weak, locks, short, dynamics, delay, lost, and
    healthy."""
    methods: tuple[str, ...] = ("learning", "posterior", "oracle", "nearest", "trials", "uniform", "healthy")
    """Of these, thompson, foreseen-only, and generalist: the one policy of each run of --generalists."""
    generalists: tuple[Path, ...] = ()
    """Finished runs with --damage-mix."""
    robots: int = 63  # of each row
    seed: int = 0
    """Of the robots. Figures that are reported are of 0; settings are chosen on others."""
    seconds: float = 10.0  # after the damage; from 20 on, the last ten are shown too
    out: str = ""  # file for every robot's numbers (JSON)
    figure: str = ""  # file for the curves (PNG)
    timing: bool = False  # only say how long what a robot computes takes


def bodies_of(lots: Sequence[Case], seed: int = 0, task: str = "x") -> list[CRobot]:
    """One robot a case; the same for all methods."""
    random = np.random.default_rng(seed)
    return [
        ROBOTS[task](lot.damage, int(random.integers(*STRIKE)), 1000 * seed + place, lot.world)
        for place, lot in enumerate(lots)
    ]


def standards(atlas: Atlas, lots: Sequence[Case]) -> list[float]:
    """m/s of the healthy robot under the scripted tripod in every case's world, from the third second on."""
    clock, task, act = atlas.about["clock_hz"], atlas.about["task"], _tripod()
    found: dict[object, float] = {}
    for lot in lots:
        if lot.world in found:
            continue
        body = ROBOTS[task]("healthy", 0, 0, lot.world)
        senses = body.reset()
        for step in range(STANDARD):
            phase = jnp.float32(step * clock / HZ % 1.0)
            seen = observation(jax.tree.map(jnp.asarray, senses), phase, task=task, kind="onboard")
            senses = body.step(np.asarray(act(seen)))
        found[lot.world] = (body.come[-1] - body.come[39]) * HZ / (STANDARD - 40)
    return [found[lot.world] for lot in lots]


@cache
def _tripod() -> Callable[[jax.Array], jax.Array]:
    return jax.jit(partial(gaits.act, gaits.load()))


def main(args: Args) -> None:
    """Walks all robots by every method and prints a table for each row.

    Raises:
        ValueError: the atlas cannot be read, a row or method is unknown, or a run's policies cannot walk these robots.
    """
    for field, given, known in (("rows", args.rows, ROWS), ("methods", args.methods, (*METHODS, generalists.NAME))):
        unknown = [name for name in given if name not in known]
        if unknown or not given:
            raise ValueError(f"{field} has {', '.join(unknown) or 'nothing'}: choose from {', '.join(known)}.")
    if args.robots < 1:
        raise ValueError(f"robots is {args.robots}: at least 1 is needed.")
    use_devices("1", solves=False)
    atlas = file.load(args.atlas)
    if args.timing:
        print(timing.report(atlas))
        return
    walks = walks_of(args, atlas)
    windows = [*WINDOWS, *([(args.seconds - 10.0, args.seconds)] if args.seconds >= 20.0 else [])]
    windows = [(first, min(last, args.seconds)) for first, last in windows if first < args.seconds]
    times = np.array([t for t in (0.5, 1, 1.5, 2, 3, 4, 5, 7, 10, 13, 16, 20, 25, 30, 40, 60) if t <= args.seconds])
    curves, kept = {}, {}
    for name in args.rows:
        kept[name], curves[name] = row(args, atlas, walks, name, windows, times)
    if args.out:
        about = {"atlas": atlas.about, "windows": windows, "times": times.tolist()}
        Path(args.out).write_text(json.dumps(about | {"retained": kept, "curves": curves}))
    if args.figure:
        figure.save(Path(args.figure), times, curves, {name: ROWS[name].said for name in args.rows})


def walks_of(args: Args, atlas: Atlas) -> dict[str, Walk]:
    """How robots go on by every method that is asked for; all runs of generalists stand where that method does."""
    if args.generalists and generalists.NAME not in args.methods:
        raise ValueError(f"generalists are given, and methods lacks {generalists.NAME}: add it, or leave them out.")
    apprentice = Apprentice(atlas) if any(METHODS[name].learns for name in args.methods if name in METHODS) else None
    found: dict[str, Walk] = {}
    for name in args.methods:
        if name == generalists.NAME:
            found |= generalists.methods(args.generalists)
        else:
            found[name] = partial(_walk, atlas, name, apprentice)
    return found


def row(
    args: Args,
    atlas: Atlas,
    walks: Mapping[str, Walk],
    name: str,
    windows: Sequence[tuple[float, float]],
    times: np.ndarray,
) -> tuple[dict[str, list], dict[str, list]]:
    """Walks one row's robots by every method, prints its table, and returns by method what they kept, and the curve."""
    lots = cases(name, args.robots, args.seed)
    standard = standards(atlas, lots)
    print(f"\n{name}: {ROWS[name].said}; {len(lots)} robots, healthy under the tripod {np.mean(standard):.3f} m/s")
    wide = max(14, *map(len, walks))
    print(f"{'method':<{wide}} " + "".join(f"{f'{a:g}-{b:g} s':<19}" for a, b in windows) + "recovered  falls   s")
    kept, curves = {}, {}
    for method, walk in walks.items():
        bodies, began = bodies_of(lots, args.seed, atlas.about["task"]), perf_counter()
        story = walk(lots, bodies, (STRIKE[1] + 1) / HZ + args.seconds)
        shares = [scores.retained(bodies, window, standard) for window in windows]
        cells = "".join(f"{scores.interval(share):<19}" for share in shares)
        recovered, fell = np.mean(shares[-1] >= RECOVERED), np.mean([body.fell for body in bodies])
        print(f"{method:<{wide}} {cells}{recovered:<10.2f} {fell:<6.2f} {perf_counter() - began:.0f}", flush=True)
        if isinstance(story, str):
            print(f"  {story}")
        else:
            inside, right, count = scores.calibration(bodies, story)
            print(
                f"  {count} segments: 95 % intervals cover {inside:.2f}, the better expected was the better {right:.2f}"
            )
            if method == next(iter(walks)):
                _found(atlas, lots, bodies, story)
        curves[method] = scores.curve(bodies, times, standard).tolist()
        kept[method] = [share.round(4).tolist() for share in shares]
    (best, first), *others = ((method, np.array(shares[-1])) for method, shares in kept.items())
    won = [f"{method} {scores.better(first, own)}" for method, own in others]
    if won:
        print(f"  {best} kept more than {', '.join(won)}")
    return kept, curves


def _walk(
    atlas: Atlas,
    method: str,
    apprentice: Apprentice | None,
    lots: Sequence[Case],
    bodies: Sequence[CRobot],
    seconds: float,
) -> recovery.Story:
    how = METHODS[method]
    learn = apprentice.learn if how.learns and apprentice else False
    each = scopes(atlas, how, lots, bodies)
    return recovery.run(atlas, bodies, seconds=seconds, scopes=each, compose=how.composes, learn=learn)


def _found(atlas: Atlas, lots: Sequence[Case], bodies: Sequence[CRobot], story: recovery.Story) -> None:
    looks = [f"{s:g} s {a:.2f} / {b:.2f}" for s in LOOKS for a, b in [scores.named(atlas, lots, bodies, story, s)]]
    print(f"  thought of first / policy within 10 % of the best usable after {', '.join(looks)}")
    told = [bool(set(names) & {body.damage}) for body, names in zip(bodies, story.twins, strict=True)]
    print(f"  put together rightly: {np.mean(told):.2f}; taken for damaged before the strike: "
          f"{scores.alarms(bodies, story):.3f}")  # fmt: skip


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
