"""The verb ``report``: the page of a run made anew, or of several runs side by side."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from srl_jax.cli.ending import leave

PROGRAM = "srl-jax report"


@dataclass(frozen=True)
class Arguments:
    """Write one page of a run as it stands, or of several finished ones in one table; every run leaves its own already.

    Runs that differ in anything but their algorithms, seeds and damages are refused.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Directories of runs."""
    out: str = ""
    """The page; empty: report.html in the run's directory, or here where there are several."""
    curves: str = ""
    """A PNG of the curves as well."""


def main(argv: list[str] | None = None) -> None:
    """Parses the command line, writes the page, prints its table; exits as `leave` says."""
    leave(_main, sys.argv[1:] if argv is None else argv)


def _main(argv: list[str]) -> int:
    arguments = tyro.cli(Arguments, args=argv, prog=PROGRAM)
    if not arguments.runs:
        raise ValueError("no run is given: name the directory of one or more.")

    from rich.console import Console

    from srl_jax.cli.progress import results
    from srl_jax.job import page
    from srl_jax.report.curves import save_curves
    from srl_jax.report.sentences import chance

    single = len(arguments.runs) == 1
    out = Path(arguments.out or (arguments.runs[0] / page.NAME if single else page.NAME))
    if out.is_dir():
        raise ValueError(f"out is {out}, a directory: give the file that the page is to be, such as {out / page.NAME}.")
    content = page.of_run(arguments.runs[0]) if single else page.of_runs(arguments.runs)
    page.write(content, out)
    if arguments.curves:
        save_curves(content.run, arguments.curves)
    console = Console(width=150)
    console.print(results(content.summary))
    for found in content.summary.get("improvement", []):
        console.print(f"P({found['x']} > {found['y']}) in {found['score']}: {chance(found)}", highlight=False)
    for sentence in content.notes:
        console.print(sentence, soft_wrap=True, highlight=False)
    console.print(f"{out}: {out.stat().st_size / 1e6:.1f} MB. Open it in a browser.", soft_wrap=True, highlight=False)
    return 0
