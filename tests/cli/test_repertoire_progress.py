"""What a person sees of a search: cells and speed, on a terminal and in a file."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from srl_jax.cli.repertoire_progress import SearchDisplay
from srl_jax.job.repertoire import Status

HERE = Path("runs/here")


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_shows_cells_and_speed(terminal):
    console = Console(file=io.StringIO(), force_terminal=terminal, color_system=None, width=160)
    with SearchDisplay(console) as display:
        display.show(Status("compiling", 0, 4096, 0, 0.0, 0.0, 0.0, HERE))
        for second in range(20):
            display.show(Status("searching", 1024, 4096, 810, 1.5, 50.0, float(second), HERE))
        display.show(Status("searching", 4096, 4096, 2000, 2.0, 50.0, 21.0, HERE))
    printed = console.file.getvalue()
    for part in ("runs/here", "50 gaits/s", "2,000 cells", "best 0.400 m/s"):
        assert part in printed
    assert terminal or printed.count("searching") == 2
