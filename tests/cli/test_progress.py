"""What a person sees of a run: a bar on a terminal, lines in a file, a table at the end."""

import dataclasses
import io
from pathlib import Path

import pytest
from rich.console import Console

from srl_jax.cli.left import Left
from srl_jax.cli.progress import Display, peak
from srl_jax.job.progress import Progress

HERE = Path("runs/here-2")
STATES = [
    Progress(HERE, "preparing", 0, 2000, 0.0, 0.0, 0.0, {}),
    Progress(HERE, "training", 1000, 2000, 2.0, 5000.0, 250.0, {"srl": {"success": 0.5, "return": 12.0}}),
    Progress(HERE, "training", 2000, 2000, 4.0, 5000.0, 250.0, {"srl": {"success": 0.75, "return": 20.0}}),
]


@pytest.mark.parametrize("terminal", [True, False])
def test_rates_and_the_latest_evaluation_are_shown(terminal):
    console = Console(file=io.StringIO(), force_terminal=terminal, color_system=None, width=160)
    with Display(console) as display:
        for state in STATES:
            display.update(state)
    printed = console.file.getvalue()
    for part in ("runs/here-2", "training", "5,000 env steps/s", "250 updates/s", "srl 0.75 (return 20.0)"):
        assert part in printed


def test_what_is_left_is_said_from_the_first_minute():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with Display(console, Left(whole=1_140.0, warmup=1_000)) as display:
        display.update(STATES[0])
    assert "preparing 0/2000 0 s 19 min left" in console.file.getvalue()


def test_a_file_gets_one_line_for_each_evaluation():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with Display(console) as display:
        for state in [STATES[1]] * 5 + [STATES[2]] * 5:
            display.update(state)
    assert console.file.getvalue().count("training") == 2


def test_nothing_is_announced_that_was_refused():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with pytest.raises(ValueError), Display(console):
        raise ValueError
    assert console.file.getvalue() == ""


def test_a_job_inside_a_job_does_not_rename_its_directory():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with Display(console) as display:
        display.update(STATES[0])
        display.update(dataclasses.replace(STATES[1], directory=HERE / "behaviour"))
    assert display.directory == HERE and "behaviour" not in console.file.getvalue()


@pytest.mark.parametrize(("used", "said"), [(1.25, ", peak 1.25 GiB"), (None, "")])
def test_memory_is_told_where_it_is_known(used, said):
    assert peak({"peak_memory_gib": used}) == said


def test_a_note_gets_a_line_of_its_own():
    console = Console(file=io.StringIO(), force_terminal=False, width=160)
    with Display(console) as display:
        display.update(dataclasses.replace(STATES[0], note="120 lanes in two waves"))
        display.update(STATES[1])
    assert console.file.getvalue().splitlines().count("120 lanes in two waves") == 1
