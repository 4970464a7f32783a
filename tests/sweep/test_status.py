"""What `--status` says."""

from datetime import UTC, datetime, timedelta

from srl_jax.cli.sweep_display import show_status
from srl_jax.sweep import attempts, status
from tests.sweep import packs


def test_packs_are_counted_and_the_rest_is_reckoned(tmp_path):
    sweep = packs.planned(tmp_path / "s", 3)  # 12 lanes in 4 packs
    for number in (0, 1):
        packs.finish(sweep, number)
    attempts.begin(sweep.pack(2).task)
    attempts.end(sweep.pack(2).task, 2, "srl_jax: memory_gb is too small")
    found = status.status(sweep, datetime.now(UTC) + timedelta(hours=2))
    assert dict(found.counts) == {"done": 2, "failed": 1, "waiting": 1}
    assert abs(found.lanes_per_hour - 3.0) < 0.01 and found.hours_left and abs(found.hours_left - 2.0) < 0.01
    first, second = status.lines(sweep, found)
    assert first == "4 packs: 2 done, 1 waiting, 1 failed; 3 lanes an hour, 2.0 hours left at this rate"
    assert second.startswith("pack 00002 failed on ")
    assert second.endswith("(1 attempt): srl_jax: memory_gb is too small")


def test_nothing_begun(tmp_path):
    sweep = packs.planned(tmp_path / "s", 3)
    assert status.lines(sweep, status.status(sweep)) == ["4 packs: 4 waiting"]


def test_lanes_of_a_finished_pack_that_failed_are_named(tmp_path, capsys):
    sweep = packs.planned(tmp_path / "s", 3)
    packs.finish(sweep, 0)
    assert show_status(sweep, watch=False) == 0
    packs.finish(sweep, 1, broken=True)
    capsys.readouterr()
    assert show_status(sweep, watch=False) == 1
    printed = capsys.readouterr().out
    assert "pack 00001 done on " in printed and printed.count("pack 0000") == 1
    assert "(1 attempt): not finite from step 1600 on: ddpg seed " in printed


def test_a_pack_that_was_cut_off_is_trouble(tmp_path):
    sweep = packs.planned(tmp_path / "s", 3)
    attempts.begin(sweep.pack(2).task)
    assert status.status(sweep).troubled[0][1].state == "cut off"
    assert show_status(sweep, watch=False) == 1
