"""What minutes of one robot's learning are worth: the numbers are those of the runs."""

import pytest

from experiments import lone_robot
from tests.report.runs import REFERENCE, STEPS, write

METHODS = {("srl", "guidance_weight=1"): 0.9, ("srl", "guidance_weight=10"): 0.3, ("ddpg_warm", ""): 0.6}
DAMAGES = ("leg_rm", "leg_lf", "leg_rm+leg_lf")
MINUTES = STEPS[-1] / 1200


@pytest.fixture
def run(tmp_path):
    """Of two variants and a rival; the rival falls on one lane at the end."""

    def edit(rows):
        lane = 2 * 2 * len(DAMAGES)  # the rival's first
        fallen = {("eval/fell", lane, STEPS[-1])}
        return [(s, i, m, float((m, i, s) in fallen) if m == "eval/fell" else x) for s, i, m, x in rows]

    return write(tmp_path / "lone", methods=METHODS, seeds=(0, 1), damages=DAMAGES, task="x", edit=edit)


def test_numbers_are_those_of_the_run(run, capsys):
    lone_robot.main(lone_robot.Arguments((run,), (MINUTES,)))
    said = [line.split() for line in capsys.readouterr().out.splitlines()]
    rows = [words for words in said if words[:1] and words[0] in ("srl", "ddpg_warm") and ">" not in words]
    worth = {" ".join(words[:-4]): (float(words[-4]), float(words[-1])) for words in rows}
    for (algo, variant), height in METHODS.items():
        share = 2 * (height + 0.005) / REFERENCE["distance"]
        assert worth[f"{algo} {variant}".strip()][0] == pytest.approx(share, abs=0.02)
    assert worth["ddpg_warm"][1] == 0.83
    assert any(words[:4] == ["probability", "that", "all", "1"] for words in said)
    better = {words[1]: words for words in said if ">" in words}
    assert better["guidance_weight=1"][4] == "1.00" and better["guidance_weight=10"][4] == "0.00"


def test_what_was_not_evaluated_is_said(run):
    with pytest.raises(ValueError, match=f"minutes has 3: the run was evaluated at 0, .*{MINUTES:g}"):
        lone_robot.main(lone_robot.Arguments((run,), (3.0,)))
    with pytest.raises(ValueError, match="runs is empty"):
        lone_robot.main(lone_robot.Arguments(()))


def test_runs_may_be_compared_with_each_other(run, tmp_path, capsys):
    other = write(tmp_path / "off", methods={("srl", ""): 0.5}, seeds=(0, 1), damages=DAMAGES, task="x")
    lone_robot.main(lone_robot.Arguments((run, other), (MINUTES,), join=True))
    said = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    (line,) = [line for line in said if line.startswith("srl guidance_weight=1, lone > srl, off ")]
    assert line.split("off ")[1].startswith("1.00")
    assert not any(" > srl guidance_weight" in line for line in said)
    few = write(tmp_path / "few", methods={("srl", ""): 0.5}, seeds=(0, 1), damages=DAMAGES[:2], task="x")
    with pytest.raises(ValueError, match="different damages"):
        lone_robot.main(lone_robot.Arguments((run, few), (MINUTES,), join=True))
