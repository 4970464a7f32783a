"""A learned estimator of the damage against the bank of observers, and both together, on the same walks.

    python -m experiments.estimator srl_jax/atlas/atlas.npz

The network learns from walks in C MuJoCo and in the simulator, in worlds of the fit's ranges; its temperature and its
weight beside the bank are fitted on walks of other seeds. Robots are those of `experiments.recovery`, with other seeds
again, led by the bank; both are asked about the very same steps. Columns are .25, .5, 1 and 2 s after the damage: who
thought of the truth first, whose belief leads to a policy within 10 % of the best by the matrix, mean log-probability
of the truth; where the damage is none of the atlas', who is sure (.5) of that, of a wrong damage, and of being healthy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle, islice
from pathlib import Path
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from experiments.estimating import judging, network, training, walks
from experiments.estimating.judging import Weights
from experiments.estimating.network import Estimator
from experiments.estimating.stories import Told, asked, told
from experiments.estimating.training import Drawn
from experiments.estimating.walks import Walks
from experiments.recovering.rows import ROWS, Case, cases
from srl_jax.atlas import file
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.robots import World
from srl_jax.cli.devices import use_devices
from srl_jax.cli.ending import leave
from srl_jax.env.damage_names import HEALTHY, parse

BEFORE = 2.3  # seconds, by which the damage of every robot has struck
FORESEEN = ("foreseen", "catalogue", "elsewhere", "delay", "lost")
STRANGE = ("faults", "kinds", "weak", "locks", "short", "triples")
SEEDS = {"weigh": 3_000, "judge": 4_000}  # apart from those of training
NEVER = ("weak", "short")  # kinds of faults that a second network never saw


@dataclass(frozen=True)
class Args:
    """Teaches the estimator and judges it."""

    atlas: tyro.conf.Positional[Path]
    converged: int = training.COURSE.converged  # walks of every damage in C MuJoCo
    simulated: int = training.COURSE.simulated  # and in the simulator
    updates: int = training.COURSE.updates
    robots: int = 63  # of every row
    seconds: float = 2.0  # after the damage
    healthy: int = 189  # healthy robots in other dynamics
    healthy_seconds: float = 12.0
    every: int = 5  # of the atlas' damages is one that a second network never saw; 0: there is no second network
    rows: tuple[str, ...] = (*FORESEEN, *STRANGE)


Ways = Mapping[str, Weights | None]  # None: the network's window alone


def taught(atlas: Atlas, drawn: Sequence[Drawn], args: Args, gone: Sequence[str] = ()) -> Estimator:
    """An estimator; where damages are `gone`, from no robot that has any of them or a fault of the kinds `NEVER`."""
    course = training.COURSE._replace(updates=args.updates, block=min(args.updates, training.COURSE.block))

    def left_out(lot: walks.Lot) -> bool:
        strange = lot.label == len(atlas.damages)
        return lot.damage in gone or (strange and any(loss.kind in NEVER for loss in parse(lot.damage)))

    kept = [np.array([not (gone and left_out(lot)) for lot in own.lots]) for own in drawn]
    learned_from, held_out = (Walks(*(x[k] for x in own.walks)) for own, k in zip(drawn, kept, strict=True))
    return training.taught(learned_from, held_out, len(atlas.damages) + 1, course)


def lots_of(name: str, count: int) -> list[Case]:
    """As `rows.cases`; `elsewhere` has any damage of the atlas, in other dynamics."""
    if name != "elsewhere":
        return cases(name, count)
    worlds = [lot.world for lot in cases("dynamics", count)]
    return [lot._replace(world=world) for lot, world in zip(cases("catalogue", count), worlds, strict=True)]


def held_out(atlas: Atlas, count: int, seconds: float) -> list[Told]:
    """Robots by which networks are weighed: damaged, healthy, and of none of these; all in other dynamics."""
    random = np.random.default_rng(SEEDS["weigh"])
    worlds = [lot.world for lot in cases("dynamics", 2 * count)[count:]]
    strange = [walks.unforeseen(atlas.damages, random) for _ in range(count)]
    known = [str(name) for name in random.choice(atlas.damages[1:], count)]
    each = (known, [HEALTHY] * count, strange)
    lots = [[Case(name, (), world) for name, world in zip(names, worlds, strict=True)] for names in each]
    return [told(atlas, own, seconds, seed) for seed, own in enumerate(lots, SEEDS["weigh"])]


def weighed(estimator: Estimator, stories: Sequence[Told]) -> Ways:
    """The ways to believe: the bank as it is and tempered more, the network with and without a memory, and both."""
    pairs = [(story, asked(estimator, story)) for story in stories]
    ways = {
        "bank": Weights(1.0, 0.0),
        "tempered": judging.fitted(pairs, [Weights(own, 0.0) for own in judging.TEMPERS]),
        "network": judging.fitted(pairs, [Weights(0.0, own) for own in judging.WEIGHTS[1:]]),
        "glance": None,
        "both": judging.fitted(pairs, [Weights(1.0, own) for own in judging.WEIGHTS]),
    }
    shown = ", ".join(f"{way} {own.bank:g} {own.network:g}" for way, own in ways.items() if own)
    print(f"weights of bank and network: {shown}")
    return ways


def beliefs_of(estimator: Estimator, story: Told, ways: Ways) -> dict[str, np.ndarray]:
    """Log-beliefs of every way."""
    said = asked(estimator, story)
    return {
        way: judging.beliefs_of(story, said, weights) if weights else judging.at_a_glance(story, said)
        for way, weights in ways.items()
    }


def show(what: str, atlas: Atlas, story: Told, beliefs: Mapping[str, np.ndarray], strange: bool) -> None:
    """Prints the table of one row, and what was gained on the bank."""
    lines = judging.strangers(story, beliefs) if strange else judging.table(atlas, story, beliefs)
    scores = {way: judging.log_score(story, belief) for way, belief in beliefs.items()}
    gained = ", ".join(f"{way} {judging.gain(own, scores['bank'])}" for way, own in scores.items() if way != "bank")
    print("\n".join([f"\n{what}", *lines, f"  log-probability of the truth, less the bank's: {gained}"]), flush=True)


def judged(atlas: Atlas, estimator: Estimator, ways: Ways, args: Args) -> None:
    """Prints a table for each row, and how well probabilities hold under damages of the atlas."""
    kept = []
    for number, name in enumerate(args.rows):
        story = told(atlas, lots_of(name, args.robots), BEFORE + args.seconds, SEEDS["judge"] + 1_000 * number)
        beliefs = beliefs_of(estimator, story, ways)
        said = ROWS[name].said if name in ROWS else "any damage of the atlas, other dynamics"
        show(f"{name}: {said}", atlas, story, beliefs, name in STRANGE)
        kept += [(story, beliefs)] if name in FORESEEN else []
    for way in ways if kept else ():
        error, bins = judging.reliability([story for story, _ in kept], [beliefs[way] for _, beliefs in kept])
        shown = " ".join(f"{own:.2f}:{was:.2f} ({share:.2f})" for own, was, share in bins)
        print(f"{way}: expected calibration error {error:.3f}; claimed:right (share) {shown}")


def healthy(atlas: Atlas, estimator: Estimator, ways: Ways, args: Args) -> None:
    """Prints which share of healthy robots in other dynamics take themselves for damaged at some step."""
    alarms: dict[str, list[np.ndarray]] = {way: [] for way in ways}
    lots = cases("healthy", args.healthy)
    for first in range(0, len(lots), args.robots):
        block = lots[first : first + args.robots]
        story = told(atlas, block, args.healthy_seconds, SEEDS["judge"] + 500 + first)
        for way, log_belief in beliefs_of(estimator, story, ways).items():
            alarms[way].append(judging.alarms(story, log_belief))
    print(f"\nhealthy robots in other dynamics that take themselves for damaged within {args.healthy_seconds:g} s")
    every = {way: np.concatenate(each) for way, each in alarms.items()}
    for way, own in every.items():
        print(f"  {way:<8} {judging.share(own)}, less the bank's {judging.gain(own, every['bank'])}")


def left_out(atlas: Atlas, drawn: Sequence[Drawn], args: Args, stories: Sequence[Told]) -> None:
    """The same of a second network that never saw some of the damages, nor weak servos and short tibiae."""
    gone = tuple(atlas.damages[args.every :: args.every])
    estimator = taught(atlas, drawn, args, gone)
    print("\nA second network")
    ways = weighed(estimator, stories)
    lots = [Case(name, (), World()) for name in islice(cycle(gone), args.robots)]
    for without, said in (((), "which the bank has"), (gone, "left out of both")):
        story = told(atlas, lots, BEFORE + args.seconds, SEEDS["judge"] + 900, without)
        what = f"{len(gone)} damages that it never saw, {said}"
        show(what, atlas, story, beliefs_of(estimator, story, ways), bool(without))
    for number, name in enumerate(NEVER):
        story = told(atlas, lots_of(name, args.robots), BEFORE + args.seconds, SEEDS["judge"] + 950 + number)
        show(f"{name}, a kind that it never saw", atlas, story, beliefs_of(estimator, story, ways), True)


def timed(estimator: Estimator, damages: int, repeats: int = 200) -> float:
    """Seconds of one forward of the network: the least of some repeats."""
    ask = jax.jit(lambda window: network.log_likelihood(estimator, window, jnp.ones(damages, bool)))
    window, found = network.standing(), []
    ask(window).block_until_ready()
    for _ in range(repeats):
        began = perf_counter()
        ask(window).block_until_ready()
        found.append(perf_counter() - began)
    return min(found)


def main(args: Args) -> None:
    """Teaches, weighs, judges.

    Raises:
        ValueError: the atlas cannot be read, a row is unknown, or there is nothing to learn from.
    """
    unknown = [name for name in args.rows if name not in (*FORESEEN, *STRANGE)]
    if unknown:
        raise ValueError(f"rows has {', '.join(unknown)}: choose from {', '.join((*FORESEEN, *STRANGE))}.")
    if min(args.converged, args.updates, args.robots) < 1 or min(args.simulated, args.healthy, args.every) < 0:
        raise ValueError(
            f"converged, updates, robots are {args.converged}, {args.updates}, {args.robots}: give at least 1 of each; "
            f"simulated, healthy, every are {args.simulated}, {args.healthy}, {args.every}: none may be negative."
        )
    use_devices("1", solves=False)
    atlas, began = file.load(args.atlas), perf_counter()
    drawn = training.draw(atlas, training.COURSE._replace(converged=args.converged, simulated=args.simulated))
    print(f"{sum(len(own.lots) for own in drawn):,} walks made in {perf_counter() - began:.0f} s", flush=True)
    began = perf_counter()
    estimator = taught(atlas, drawn, args)
    size = sum(leaf.size for leaf in jax.tree.leaves(estimator.params))
    print(f"{size:,} parameters, learned in {perf_counter() - began:.0f} s; temperature {estimator.temperature:.2f}")
    stories = held_out(atlas, args.robots, BEFORE + args.seconds)
    ways = weighed(estimator, stories)
    judged(atlas, estimator, ways, args)
    if args.healthy:
        healthy(atlas, estimator, ways, args)
    if args.every:
        left_out(atlas, drawn, args, stories)
    print(f"\none forward of the network: {timed(estimator, len(atlas.damages)):.2g} s")


if __name__ == "__main__":
    leave(main, tyro.cli(Args))
