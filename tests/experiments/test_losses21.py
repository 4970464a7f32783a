"""All methods of the 21 losses are judged alike, or refused; the numbers of the table are those of the runs."""

import subprocess

import numpy as np
import pytest

from experiments import losses21
from srl_jax.cli import run as cli
from srl_jax.env.damage_names import losses21 as names
from srl_jax.job import plan
from tests.report.runs import CONFIG, HEALTHY, REFERENCE, STEPS, write

SETTINGS = CONFIG | {"behaviour": "gait"}
SEEDS = (0, 1)
TRIALS, LEARNERS = {("tripod", ""): 0.3, ("ite", ""): 0.6}, {("srl", ""): 0.9}


def seconds(rows):
    """Trials take 20 s a seed more, and the last total is the one that counts."""
    lanes = range(42, 84)
    return rows + [(step, i, "gauge/trial_seconds", step / 10 + 20 * (i >= 63)) for step in STEPS for i in lanes]


def written(path, methods=TRIALS, settings=SETTINGS, edit=seconds, **options):
    return write(path, methods=methods, seeds=SEEDS, damages=names(), task="x", config=settings, edit=edit, **options)


@pytest.fixture
def runs(tmp_path):
    """The run of tripod and ite, and one of SRL."""
    srl = written(tmp_path / "srl", LEARNERS, edit=lambda rows: rows, settings=SETTINGS | {"steps": 50_000})
    return written(tmp_path / "trials"), srl


def test_numbers_are_those_of_the_runs(runs):
    read = {path: losses21.read(path) for path in runs}
    losses21.check(runs[0], runs[1:])
    found = losses21.together(read)
    assert list(found) == ["tripod", "ite", "srl"]
    for name, height in (("tripod", 0.3), ("ite", 0.6), ("srl", 0.9)):
        distance = 2 * (height * 2.5 / 3 + 0.01 * np.array(SEEDS))  # the mean of the last two evaluations
        np.testing.assert_allclose(found[name]["distance"], np.broadcast_to(distance[:, None], (2, 21)))
        np.testing.assert_allclose(found[name]["retained"], found[name]["distance"] / REFERENCE["distance"])
        own = losses21.best_of_map() if name == "ite" else HEALTHY["distance"]
        np.testing.assert_allclose(found[name]["retained_own"], found[name]["distance"] / own)
    np.testing.assert_allclose(found["ite"]["seconds"], [[30.0] * 21, [50.0] * 21])
    assert found["tripod"]["seconds"].max() == 0.0 and found["srl"]["seconds"].min() == 2500.0


def test_recovered_means_no_fall_and_half_of_the_common_speed(tmp_path):
    def edit(rows):  # tripod keeps .255 of the speed; ite .505 and .515, but with leg_rf lost it falls once
        fallen = {("eval/fell", 42, 200)}
        rows = [(s, i, m, float((m, i, s) in fallen) if m == "eval/fell" else x) for s, i, m, x in rows]
        return seconds(rows)

    run = losses21.read(written(tmp_path, edit=edit))
    table = losses21.summarise(losses21.scores(run, tmp_path), 5.0)
    cells = {str(column.header): list(column.cells) for column in table.columns}
    assert cells["method"] == ["tripod", "ite"]
    assert [cell.split()[0] for cell in cells["recovered"]] == ["0.00", f"{41 / 42:.2f}"]
    assert [cell.split()[0] for cell in cells["speed m/s"]] == ["0.10", "0.20"]
    assert cells["robot time s"] == ["0", "40"]
    assert [cell.split(", ")[1] for cell in cells["one leg, two"]] == ["0.26", "0.51"]


def test_damages_stand_in_the_order_of_the_benchmark(tmp_path):
    turned = names()[::-1]
    path = write(tmp_path, methods={("tripod", ""): 0.3}, seeds=SEEDS, damages=turned, task="x", config=SETTINGS)
    found = losses21.scores(losses21.read(path), path)["tripod"]["teacher_success"]
    np.testing.assert_allclose(found[0], [0.1 + 0.1 * turned.index(name) for name in names()])


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"evaluation": {"episodes": 4}}, r"evaluation\.episodes"),
        ({"evaluation": {}, "train": {"environments": 4}}, r"evaluation\.episodes"),
        ({"env": {"episode_steps": 50}}, r"env\.episode_steps"),
    ],
)
def test_runs_that_were_judged_otherwise_are_refused(runs, tmp_path, monkeypatch, changed, named):
    other = written(tmp_path / "other", LEARNERS, SETTINGS | changed, edit=lambda rows: rows)
    message = rf"other was judged otherwise than .*{{}}: they differ in .*{named}.*\."
    with pytest.raises(ValueError, match=message.format("trials")):
        losses21.main(losses21.Arguments(others=(runs[1], other), runs=runs[0]))
    monkeypatch.setattr(subprocess, "run", lambda words: pytest.fail("trained before it looked"))
    with pytest.raises(ValueError, match=message.format("new")):
        losses21.main(losses21.Arguments(others=(other,), runs=tmp_path / "new"))


def test_a_run_that_cannot_be_judged_is_refused(runs, tmp_path):
    early = written(tmp_path / "early", edit=lambda rows: [row for row in rows if row[0] <= 100])
    with pytest.raises(ValueError, match="early has 1 evaluations after its start"):
        losses21.read(early)
    old = written(tmp_path / "old", edit=lambda rows: rows)
    with pytest.raises(ValueError, match="no gauge/trial_seconds for ite: train it anew"):
        losses21.scores(losses21.read(old), old)
    other = write(tmp_path / "other", task="x")
    with pytest.raises(ValueError, match="3 damages: x and losses21 are needed"):
        losses21.read(other)


def test_the_whole_command_on_finished_runs(runs, tmp_path, capsys):
    (runs[0] / "summary.json").write_text("{}")
    losses21.main(losses21.Arguments(others=(runs[1],), runs=runs[0], out=tmp_path / "figures" / "losses.png"))
    printed = capsys.readouterr().out
    assert "healthy tripod 0.400 m/s" in printed and "srl" in printed and "Mailer" in printed
    assert (tmp_path / "figures" / "losses.png").stat().st_size > 10_000


def test_its_own_run_ends_with_two_evaluations_after_the_last_trial(tmp_path):
    words = losses21.command(losses21.Arguments(runs=tmp_path / "new", seeds="3"))
    _, chosen = cli.parse(words)
    assert len(plan.make(chosen).lanes) == 2 * 21 * 3
    assert chosen.evaluation.episodes == 10
    longest = chosen.ite.trials * chosen.env.episode_steps * chosen.train.environments
    assert longest <= chosen.steps - 2 * chosen.train.evaluate_every


def test_a_run_that_fails_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(subprocess, "run", lambda words: subprocess.CompletedProcess(words, 2))
    with pytest.raises(ValueError, match="did not finish: see what it said"):
        losses21.main(losses21.Arguments(runs=tmp_path / "new"))
