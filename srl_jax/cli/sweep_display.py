"""What a sweep shows on a terminal: packs that end, how all of them stand, and the table of those that are merged."""

import time

from srl_jax.sweep import task
from srl_jax.sweep.manifest import Sweep

WATCH = 10.0  # s between two looks at the packs
INCOMPLETE = 1  # exit code where packs are missing or lanes have failed
SHOWN = 20  # lanes that are named


def told(number: int, code: int) -> None:
    """One line for every pack that ends."""
    ends = {task.DONE: "done", task.USAGE: "refused", task.IN_USE: "in use elsewhere"}
    print(f"{time.strftime('%H:%M:%S')} pack {number:05d} {ends.get(code, f'ended with code {code}')}", flush=True)


def merge(sweep: Sweep) -> int:
    """Merges, and prints the table; 1 where something is missing."""
    from rich.console import Console

    from srl_jax.cli.progress import results
    from srl_jax.sweep import lease
    from srl_jax.sweep import merge as merging

    try:
        summary = merging.merge(sweep)
    except lease.HeldError as error:
        print(f"Another merge is under way: {error}")
        return task.IN_USE
    about = summary["sweep"]
    console = Console(width=150)
    if summary["methods"]:
        console.print(results(summary))
    console.print(
        f"{about['merged']} of {about['packs']} packs merged into {sweep.directory / 'merged'}", soft_wrap=True
    )
    for line in [*_missing(about), *_failed(summary), *about["left_out"]]:
        console.print(line, soft_wrap=True, highlight=False)
    return 0 if about["complete"] else INCOMPLETE


def _missing(about: dict) -> list[str]:
    lines = [f"pack {x['pack']:05d} is missing: {x['state']} {x['error']}".rstrip() for x in about["missing"]]
    more = about["packs"] - about["merged"] - len(lines)
    return [*lines, *([f"and {more} more packs are missing."] if more > 0 else [])]


def _failed(summary: dict) -> list[str]:
    lanes = summary["nonfinite_lanes"]
    named = [
        f"lane {x['lane']} ({x['algo']} {x['variant']} seed {x['seed']} {x['damage']}) was not finite at step "
        f"{x['step']}: that counts as failed."
        for x in lanes[:SHOWN]
    ]
    return [*named, *([f"and {len(lanes) - SHOWN} more lanes were not finite."] if len(lanes) > SHOWN else [])]


def show_status(sweep: Sweep, *, watch: bool) -> int:
    """Prints how the packs stand; 1 where one has failed or was cut off, or has lanes that failed."""
    from srl_jax.sweep import status

    while True:
        found = status.status(sweep)
        print("\n".join(status.lines(sweep, found)), flush=True)
        open_ = found.counts["running"] + found.counts["waiting"] + found.counts["cut off"]
        if not watch or not open_:
            return INCOMPLETE if found.troubled else 0
        time.sleep(WATCH)
