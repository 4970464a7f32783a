"""The verb ``sweep``: bad input is one sentence before anything is written, and a dry run writes nothing."""

import pytest

from srl_jax.cli import sweep
from srl_jax.cli.main import main as srl_jax
from srl_jax.sweep import slurm
from tests.sweep import packs

SMOKE = ["--preset", "smoke"]


def ended(words, capsys):
    with pytest.raises(SystemExit) as end:
        sweep.main(words)
    printed = capsys.readouterr()
    return end.value.code, printed.out, printed.err


REFUSED = {
    "pack_lanes is 'many': give auto or a number": ["--pack-lanes", "many"],
    "pack_lanes is 1: that makes 4 packs, but ddpg has 2 of 4 lanes": ["--pack-lanes", "1"],
    "seeds is 'x'": ["--seeds", "x"],
    "grid has 'srl.hiden': that is no setting of a run": ["--grid", "srl.hiden=1"],
    "behaviour is train: every pack would train it anew": ["--behaviour", "train"],
    "cpus is 64 and jobs 1: together they want 64 cores": ["--cpus", "64"],
    "engine is slurm: no sbatch is on the PATH": ["--engine", "slurm", "--cpus", "1"],
    "grid has task: its points could not stand in one table": ["--grid", "task=x;p2p"],
    "grid has train: its points could not stand in one table": ["--grid", "train.evaluate-every=400;800"],
    "behaviour is train: every": ["--behaviour", "gait,train"],
    "a pack needs 1.": ["--memory-gb", "0.9", "--pack-lanes", "4"],
}


@pytest.mark.parametrize("said", REFUSED)
def test_bad_input_is_one_sentence_and_nothing_is_written(said, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PATH", "")
    code, _, error = ended([*SMOKE, "--out", str(tmp_path / "s"), *REFUSED[said]], capsys)
    assert code == 2 and error.startswith("srl_jax: ") and said in error and error.count("\n") == 1
    assert not (tmp_path / "s").exists()


def test_a_dry_run_prints_plan_and_script_and_writes_nothing(tmp_path, capsys):
    words = [
        *SMOKE,
        "--seeds",
        "6",
        "--out",
        str(tmp_path / "s"),
        "--pack-lanes",
        "4",
        "--engine",
        "slurm",
        "--dry-run",
    ]
    code, printed, _ = ended(words, capsys)
    assert code == 0 and not (tmp_path / "s").exists()
    assert "12 lanes in 3 packs of up to 4, each on 4 cores" in printed and "core hours" in printed
    assert (
        f"pack 00002: srl-jax run --preset smoke --seeds 6 --devices 4 --part 3/3 --out {tmp_path}/s/packs/00002"
        in printed
    )
    assert "#SBATCH --signal=B:USR1@120" in printed and "scontrol requeue" in printed


def test_a_manifest_alone(tmp_path, capsys):
    assert ended([*SMOKE, "--out", str(tmp_path / "s"), "--plan-only"], capsys)[0] == 0
    assert [path.name for path in (tmp_path / "s").iterdir()] == ["sweep.json"]


@pytest.mark.parametrize("verb", ["--status", "--merge", "--resume", "--cancel", "--run-pack=0"])
def test_verbs_of_a_sweep_that_there_is_not(verb, tmp_path, capsys):
    code, _, error = ended(["--out", str(tmp_path), verb], capsys)
    assert code == 2 and "is not the directory of a sweep" in error


def test_a_sweep_keeps_its_settings(tmp_path, capsys):
    packs.planned(tmp_path / "s")
    code, _, error = ended(["--out", str(tmp_path / "s"), "--resume", "--seeds", "4"], capsys)
    assert code == 2 and "--seeds 4: the sweep in" in error


def test_status_and_merge(tmp_path, capsys):
    made = packs.planned(tmp_path / "s")
    assert ended(["--out", str(tmp_path / "s"), "--status"], capsys) == (0, "3 packs: 3 waiting\n", "")
    for number in (0, 2):
        packs.finish(made, number)
    code, printed, _ = ended(["--out", str(tmp_path / "s"), "--merge"], capsys)
    assert code == 1 and "2 of 3 packs merged into" in printed and "pack 00001 is missing: waiting" in printed
    packs.finish(made, 1)
    code, printed, _ = ended(["--out", str(tmp_path / "s"), "--resume"], capsys)
    assert code == 0 and "3 of 3 packs merged" in printed and "srl" in printed


def test_a_time_limit_below_one_checkpoint(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(slurm, "check", lambda options: None)
    monkeypatch.setattr(slurm, "check_shared", lambda directory: None)
    words = ["--seeds", "100", "--out", str(tmp_path / "s"), "--engine", "slurm", "--time", "5", "--pack-lanes", "600"]
    code, _, error = ended(words, capsys)
    assert code == 2 and "time is 5: a pack reaches its first checkpoint after some" in error
    assert not (tmp_path / "s").exists()


def test_it_is_among_the_verbs(capsys):
    with pytest.raises(SystemExit):
        srl_jax(["--help"])
    assert "sweep" in capsys.readouterr().out


def test_a_sweep_is_resumed_as_it_was_begun_but_for_what_is_said_anew(tmp_path, capsys, monkeypatch):
    orders = []
    monkeypatch.setattr(sweep.local, "run", orders.append)
    monkeypatch.setattr(sweep, "merge", lambda made: 0)
    out = ["--out", str(tmp_path / "s")]
    assert ended([*SMOKE, *out, "--cpus", "1", "--retries", "7", "--plan-only"], capsys)[0] == 0
    assert ended([*out, "--resume"], capsys)[0] == 0
    assert ended([*out, "--resume", "--retries", "1"], capsys)[0] == 0
    assert [(order.cpus, order.jobs, order.retries) for order in orders] == [(1, 1, 7), (1, 1, 1)]


def test_slurm_is_told_how_much_memory_a_pack_needs(tmp_path, capsys):
    words = [*SMOKE, "--out", str(tmp_path / "s"), "--engine", "slurm", "--cpus", "1", "--dry-run"]
    assert "#SBATCH --mem=12" in ended(words, capsys)[1], "a GiB and a quarter for so small a pack"
