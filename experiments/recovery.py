"""How soon a robot walks on after its damage: who chooses how, speed retained and falls, from the moment it strikes.

    python -m experiments.recovery runs/atlas-.../atlas.npz --damages losses21 --left-out

Robots are C MuJoCo at 2 ms and 50 iterations on another floor, with noisy sensors; the damage strikes in mid-stride and
robot time counts from there. Speeds are shares of what the healthy robot walks in the same world under the scripted
tripod; recovered is no fall, and half of that in the last window.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from srl_jax.atlas import file, recovery
from srl_jax.atlas.choice import RULES
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.mind import Scope
from srl_jax.atlas.recovery import Story
from srl_jax.atlas.robots import CRobot, World
from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.env import damage_names
from srl_jax.env import gait as gaits
from srl_jax.env.senses import observation
from srl_jax.statistics import iqm, stratified_interval

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
    damages: str = "losses21"  # names and sets, as --damage of a run
    seeds: int = 3  # robots of each damage
    left_out: bool = False  # each damage is left out of the atlas for its own robots: hypotheses and policies
    compose: bool = True  # whether robots put damages together from silent servos
    seconds: float = 10.0  # after the damage; from 20 on, its last ten are shown too
    friction: float = 0.8  # share of the atlas' own
    rules: str = ",".join(RULES)  # of choice, beside the oracle and the policy of the healthy


def robots(names: Sequence[str], seeds: int, world: World) -> list[CRobot]:
    """One robot for every damage and seed; the same for all rules."""
    random = np.random.default_rng(0)
    return [CRobot(name, int(random.integers(*STRIKE)), seed, world) for name in names for seed in range(seeds)]


def tripod_speed(atlas: Atlas, bodies: Sequence[CRobot]) -> float:
    """m/s of healthy robots under the scripted tripod, from the third second on: what all is compared with."""
    clock, act = atlas.about["clock_hz"], jax.jit(partial(gaits.act, gaits.load()))
    for body in bodies:
        senses = body.reset()
        for step in range(STANDARD):
            phase = jnp.float32(step * clock / HZ % 1.0)
            seen = observation(jax.tree.map(jnp.asarray, senses), phase, task="x", kind="onboard")
            senses = body.step(np.asarray(act(seen)))
    return float(np.mean([b.positions[-1][0] - b.positions[39][0] for b in bodies]) * HZ / (STANDARD - 40))


def scopes(atlas: Atlas, bodies: Sequence[CRobot], left_out: bool, rule: str) -> Callable[[int], list[Scope]]:
    """What each robot may use of the atlas at a control step; whom the oracle names once the damage has struck."""
    value, own_rule = atlas.value, rule if rule in RULES else RULES[0]
    healthy = int(np.argmax(value[:, 0]))
    own = [recovery.scope(atlas, [body.damage] if left_out else [], rule=own_rule) for body in bodies]
    told = np.full((2, len(bodies)), -1 if rule in RULES else healthy)  # before the strike, and after it
    if rule == "oracle":
        for number, body in enumerate(bodies):
            if body.damage in atlas.damages:
                column = np.where(own[number].policies, value[:, atlas.damages.index(body.damage)], -np.inf)
                told[1, number] = np.argmax(column)

    def at(step: int) -> list[Scope]:
        struck = [int(step >= body.strike) for body in bodies]
        return [
            mine._replace(told=np.array(told[now, i])) for i, (mine, now) in enumerate(zip(own, struck, strict=True))
        ]

    return at


def retained(bodies: Sequence[CRobot], window: tuple[float, float], healthy: float) -> np.ndarray:
    """Share of the healthy speed f64[N] over seconds after the damage; 0 for a robot that fell."""
    first, last = (round(HZ * second) for second in window)
    speeds = [(b.positions[b.strike + last - 1][0] - b.positions[b.strike + first - 1][0]) for b in bodies]
    kept = np.array(speeds) / (window[1] - window[0]) / healthy
    return np.where([b.fell for b in bodies], 0.0, kept)


def named(atlas: Atlas, bodies: Sequence[CRobot], story: Story, seconds: float) -> tuple[float, float]:
    """How often the damage was named first, and how often the policy in command was within 10 % of the best."""
    right, good = [], []
    for i, body in enumerate(bodies):
        if body.damage not in atlas.damages:
            continue
        step, column = body.strike + round(seconds * HZ), atlas.damages.index(body.damage)
        right.append(np.argmax(story.log_belief[step, i]) == column)
        good.append(atlas.value[story.policy[step, i], column] >= 0.9 * atlas.value[:, column].max())
    return float(np.mean(right)), float(np.mean(good))


def alarms(bodies: Sequence[CRobot], story: Story) -> float:
    """Share of robots that took themselves for damaged at some step before they were; at any, if they never were."""
    healthy = np.exp(story.log_belief[:, :, 0])
    ends = [len(healthy) if body.damage == damage_names.HEALTHY else body.strike + 1 for body in bodies]
    return float(np.mean([healthy[:end, i].min() < 0.5 for i, end in enumerate(ends)]))


def main(args: Args) -> None:
    """Walks all robots by every rule and prints the table.

    Raises:
        ValueError: the atlas cannot be read, or a damage has no meaning.
    """
    if args.seeds < 1:
        raise ValueError(f"seeds is {args.seeds}: at least 1 is needed.")
    use_devices("1", solves=False)
    atlas = file.load(args.atlas)
    names, world = damage_names.parse_names(args.damages, atlas.about["task"]), World(friction=args.friction)
    windows = [*WINDOWS, *([(args.seconds - 10.0, args.seconds)] if args.seconds >= 20.0 else [])]
    seconds = (STRIKE[1] + 1) / HZ + windows[-1][1]
    healthy = tripod_speed(atlas, robots(["healthy"], args.seeds, world))
    print(f"{len(names)} damages x {args.seeds} robots; healthy, under the tripod: {healthy:.3f} m/s in this world.")
    print(f"{'rule':<10} " + "".join(f"{f'{first:g}-{last:g} s':<19}" for first, last in windows) + "recovered  falls")
    for rule in ("oracle", "healthy", *args.rules.split(",")):
        bodies = robots(names, args.seeds, world)
        each = scopes(atlas, bodies, args.left_out, rule)
        story = recovery.run(atlas, bodies, seconds=seconds, scopes=each, compose=args.compose)
        print(row(rule, [retained(bodies, window, healthy) for window in windows], bodies, args.seeds), flush=True)
        if rule == RULES[0]:
            looks = [f"{s:g} s {a:.2f} / {b:.2f}" for s in LOOKS for a, b in [named(atlas, bodies, story, s)]]
            print(f"  named first / policy within 10 % of the best after {', '.join(looks)}")
            print(f"  taken for damaged before the strike: {alarms(bodies, story):.3f}")


def row(rule: str, kept: Sequence[np.ndarray], bodies: Sequence[CRobot], seeds: int) -> str:
    """A line of the table: the IQM of each window with its interval, recovered in the last one, falls."""
    cells = []
    for shares in kept:
        grid = shares.reshape(-1, seeds).T
        low, high = stratified_interval(grid, iqm)
        cells.append(f"{iqm(grid):.2f} [{low:.2f}, {high:.2f}]")
    recovered, fell = np.mean(kept[-1] >= RECOVERED), np.mean([body.fell for body in bodies])
    return f"{rule:<10} {''.join(f'{cell:<19}' for cell in cells)}{recovered:<10.2f} {fell:.2f}"


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
