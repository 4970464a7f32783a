"""The notebook runs from its first cell to its last, and is stored without outputs, so that changes can be read."""

import matplotlib.pyplot as plt

from tests.docs.reading import NOTEBOOK, cells


def test_it_runs(monkeypatch, tmp_path):
    """All cells in one namespace, in an empty folder; figures that they show are counted and closed."""
    shown, space = [], {"__name__": "notebook"}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plt, "show", lambda: (shown.append(plt.gcf()), plt.close("all")))
    for number, cell in enumerate(cells(), 1):
        exec(compile(cell.code, f"{NOTEBOOK.name}, cell {number}", "exec"), space)
    assert len(shown) == 3


def test_it_is_stored_without_what_a_run_of_it_left():
    assert all(cell.count is None and not cell.outputs for cell in cells())
