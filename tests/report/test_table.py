"""The closing table says what the summary holds, briefly."""

from srl_jax.report.data import read_metrics
from srl_jax.report.summary import summarise
from srl_jax.report.table import cell, format_table
from tests.report.runs import write


def test_table_reads_like_a_paper(tmp_path):
    header, ddpg, srl, _ = format_table(summarise(read_metrics(write(tmp_path))))
    assert header == ["method", "success", "return", "area", "retained", "steps to finish"]
    assert ddpg[0] == "ddpg" and ddpg[-1] == "never"
    assert srl[1].startswith((".55 [.5", ".54 [.5"))
    assert srl[2].startswith("54.5 [5") and srl[3].startswith((".34 [.3", ".35 [.3")) and srl[5].startswith("250 [")


def test_what_was_not_recorded_is_a_dash(tmp_path):
    write(tmp_path, edit=lambda rows: [row for row in rows if row[2].startswith(("eval/return", "eval/fell"))])
    _, ddpg, *_ = format_table(summarise(read_metrics(tmp_path), resamples=50))
    assert (ddpg[1], ddpg[3], ddpg[4], ddpg[5]) == ("-", "-", "-", "-") and ddpg[2].startswith("21.2 [")


def test_nothing_has_no_minus():
    assert cell("return", {"iqm": 0.0, "low": -1e-16, "high": -0.01}) == ".00 [.00, -.01]"


def test_numbers_have_the_decimals_that_they_deserve():
    entry = lambda iqm, low, high: {"iqm": iqm, "low": low, "high": high}  # noqa: E731
    overall = {
        "success": entry(0.5, -0.25, 1.0),
        "return": entry(123.4, 99.6, 130.2),
        "area_return": entry(50.94, 46.44, 55.0),
        "retained": entry(9.994, 1.0, 9.0),
        "steps_to_finish": entry(12_345.0, 999.0, None),
    }
    rows = format_table({"task": "x", "methods": {"srl": {"overall": overall}}})
    assert rows[1:] == [
        ["srl", ".50 [-.25, 1.00]", "123 [100, 130]", "50.9 [46.4, 55.0]", "9.99 [1.00, 9.00]", "12.3k [999, never]"]
    ]
