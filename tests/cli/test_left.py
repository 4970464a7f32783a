"""How long a run has still to go: arithmetic at first, then its own pace, which the warm-up does not flatter."""

from pathlib import Path

import pytest

from srl_jax.cli.left import Left, said
from srl_jax.job.progress import Progress


def status(phase, step, directory="run"):
    return Progress(Path(directory), phase, step, 10_000, 0.0, 0.0, 0.0, {})


def test_arithmetic_is_believed_until_the_run_has_learned_for_a_while():
    now = [0.0]
    left = Left(600.0, warmup=1_000, clock=lambda: now[0])
    seen = []
    for seconds, phase, step in [
        (1.0, "preparing", 0),
        (50.0, "compiling, then following pi_B", 0),
        (55.0, "training", 500),  # fast: nothing is learned yet
        (60.0, "training", 1_000),
        (70.0, "training", 1_200),
        (100.0, "training", 1_800),  # 20 steps a second
        (150.0, "training", 2_800),
    ]:
        now[0] = seconds
        seen.append(left.seconds(status(phase, step)))
    assert seen == pytest.approx([599.0, 550.0, 545.0, 540.0, 530.0, 8_200 / 20, 7_200 / 20])


def test_without_arithmetic_nothing_is_said_at_first_and_a_run_inside_a_run_has_its_own_pace():
    now = [0.0]
    left = Left(clock=lambda: now[0])
    assert left.seconds(status("training", 0, "run/behaviour")) is None
    now[0] = 40.0
    assert left.seconds(status("training", 4_000, "run/behaviour")) == pytest.approx(60.0)
    assert left.seconds(status("training", 0)) is None
    late = Left(20.0, clock=lambda: now[0])
    assert late.seconds(status("preparing", 0)) == 20.0
    now[0] += 30.0
    assert late.seconds(status("preparing", 0)) is None, "it was wrong, and is not believed any longer"
    assert said(None) == ""


@pytest.mark.parametrize(
    ("seconds", "words"), [(42.4, "42 s left"), (1_140.0, "19 min left"), (9_000.0, "2.5 h left"), (0.0, "0 s left")]
)
def test_it_is_said_in_a_unit_that_suits(seconds, words):
    assert said(seconds) == words
