"""The notebook runs from its first cell to its last, and is stored without outputs, so that changes can be read."""

import ast

import matplotlib.pyplot as plt
import pytest

from tests.docs.reading import NOTEBOOK, cells

CELLS = cells()


def follow(own, monkeypatch, folder):
    """Runs cells in one namespace, in an empty folder; figures that they show are counted and closed."""
    shown = []
    monkeypatch.chdir(folder)
    monkeypatch.setattr(plt, "show", lambda: (shown.append(plt.gcf()), plt.close("all")))
    space = {"__name__": "notebook"}
    for number, cell in enumerate(own, 1):
        exec(compile(cell.code, f"{NOTEBOOK.name}, cell {number}", "exec"), space)
    return len(shown)


def test_it_runs_but_for_its_training(monkeypatch, tmp_path):
    assert follow([cell for cell in CELLS if not cell.slow], monkeypatch, tmp_path) == 2


@pytest.mark.slow
def test_all_of_it_runs(monkeypatch, tmp_path):
    assert follow(CELLS, monkeypatch, tmp_path) == 3


def test_it_is_stored_without_what_a_run_of_it_left():
    assert all(cell.count is None and not cell.outputs for cell in CELLS)


def test_its_slow_cells_come_last():
    slow = [cell.slow for cell in CELLS]
    assert slow == sorted(slow) and any("run --preset smoke" in cell.code for cell in CELLS if cell.slow)
    assert all(ast.parse(cell.code) for cell in CELLS)
