"""What a person sees of a run: a bar on a terminal, lines in a file, a table at the end."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from srl_jax.cli.progress import Display
from srl_jax.job.loop import Progress

STATES = [
    Progress("preparing", 0, 2000, 0.0, 0.0, 0.0, {}),
    Progress("training", 1000, 2000, 2.0, 5000.0, 250.0, {"srl": {"success": 0.5, "return": 12.0}}),
    Progress("training", 2000, 2000, 4.0, 5000.0, 250.0, {"srl": {"success": 0.75, "return": 20.0}}),
]


@pytest.mark.parametrize("terminal", [True, False])
def test_rates_and_the_latest_evaluation_are_shown(terminal):
    console = Console(file=io.StringIO(), force_terminal=terminal, color_system=None, width=160)
    with Display(Path("runs/here"), console) as display:
        for state in STATES:
            display.update(state)
    printed = console.file.getvalue()
    for part in ("runs/here", "training", "5,000 env steps/s", "250 updates/s", "srl 0.75 (return 20.0)"):
        assert part in printed


def test_a_file_gets_one_line_for_each_evaluation():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with Display(Path("x"), console) as display:
        for state in [STATES[1]] * 5 + [STATES[2]] * 5:
            display.update(state)
    assert console.file.getvalue().count("training") == 2


def test_nothing_is_announced_that_was_refused():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with pytest.raises(ValueError), Display(Path("x"), console):
        raise ValueError
    assert console.file.getvalue() == ""
