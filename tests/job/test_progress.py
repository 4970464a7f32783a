"""What a run tells of itself: totals over several processes, and slices whose length follows what they take."""

from types import SimpleNamespace

import pytest

from srl_jax.config import preset
from srl_jax.job import progress
from srl_jax.job.loop import Loop
from srl_jax.job.progress import Pace, Totals


@pytest.fixture
def clock(monkeypatch):
    """A clock that the test moves."""
    now = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    return now


def test_a_slice_is_as_long_as_the_last_ones_allow(clock):
    pace = Pace(target=2.0)
    assert pace.steps == 1, "nothing is known yet, and a step of thousands of lanes may take long"
    for seconds, steps in ((0.5, 4), (8.0, 1), (0.0, None)):
        with pace.timing(2):
            clock[0] += 2 * seconds
        assert steps is None or pace.steps == steps
    assert pace.steps > 1_000


def test_totals_go_on_from_an_earlier_process(clock, monkeypatch):
    monkeypatch.setattr(progress.machine, "peak_memory_gib", lambda: 3.0)
    first = Totals()
    with first.training():
        clock[0] += 10.0
    first.trained += 1_000
    second = Totals(**first.stored(compile_seconds=30.0))
    with second.training():
        clock[0] += 5.0
    second.trained += 500
    monkeypatch.setattr(progress.machine, "peak_memory_gib", lambda: 2.0)
    config = preset("default")
    found = second.summary(config, lanes=4, learners=3, devices=2, compile_seconds=7.0)
    assert (found["training_seconds"], found["compile_seconds"], found["peak_memory_gib"]) == (15.0, 37.0, 3.0)
    assert found["environment_steps_per_second"] == 4 * 1_500 / 15
    each = 1_500 / 15 / (config.train.environments * config.train.update_every)
    assert found["updates_per_second"] == round(3 * each), "a lane without a replay has no updates"


def test_totals_of_nothing_have_no_rate():
    assert Totals().rates(preset("default"), 4, 2) == (0.0, 0.0)


def test_the_rate_shown_between_two_slices_counts_the_time_of_both(clock):
    """Three vector steps of ten environments, in slices of one: each takes 2 s, so every look sees 5 steps/s a lane."""
    shown = []

    def chunk(state, tally, lanes, mode, steps):
        clock[0] += 2.0 * steps
        return state, tally

    loop = SimpleNamespace(
        paces={True: Pace(), False: Pace()},
        totals=Totals(),
        engine=SimpleNamespace(chunk=chunk),
        config=preset("default"),
        stopped=lambda: False,
    )
    loop.show = lambda phase, step: shown.append(loop.totals.rates(loop.config, 1, 1)[0])
    state = SimpleNamespace(clock=0)
    Loop.advance(loop, state, None, None, SimpleNamespace(learn=True), 3)
    assert shown == [5.0, 5.0, 5.0]
    Loop.advance(loop, state, None, None, SimpleNamespace(learn=False), 3)
    assert len(shown) == 3 and loop.totals.training_seconds == 6.0, "an evaluation is not training"
