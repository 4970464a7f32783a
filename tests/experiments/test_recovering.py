"""The parts of the recovery experiment: lots, and how robots are scored."""

from types import SimpleNamespace

import numpy as np
import pytest

from experiments.recovering import rows, scores, timing
from srl_jax.atlas.trials import Ended, Forecast
from srl_jax.env.damage_names import canonical, losses21, parse


@pytest.mark.parametrize("name", rows.ROWS)
def test_lots_are_always_the_same_and_of_damages_that_have_a_name(name):
    lots = rows.cases(name, 30)
    assert lots == rows.cases(name, 30) and len(lots) == 30
    assert all(canonical(lot.damage) == lot.damage for lot in lots)
    assert lots[:10] == rows.cases(name, 10) or not callable(rows.ROWS[name].damages)


def test_what_is_left_out_is_the_damage_itself_or_all_that_concern_several_legs():
    assert {lot.damage for lot in rows.cases("left-out", 21)} == set(losses21())
    assert all(lot.without == (lot.damage,) for lot in rows.cases("left-out", 21))
    lot = rows.cases("pairs", 15)[0]
    assert lot.damage in lot.without and len(lot.without) == 15
    assert all(len({loss.leg for loss in parse(name)}) == 2 for name in lot.without)
    assert not rows.cases("triples", 3)[0].without


def body(speed, strike=20, fell=False, steps=240, damage="leg_rm"):
    """Stands until the strike and walks then."""
    come = np.maximum(np.arange(1, steps + 1) - strike, 0) * speed / scores.HZ
    return SimpleNamespace(come=come.tolist(), strike=strike, fell=fell, damage=damage)


def test_shares_are_of_each_ones_own_standard_and_a_fall_keeps_nothing():
    bodies = [body(0.4), body(0.4, strike=40), body(0.4, fell=True)]
    np.testing.assert_allclose(scores.retained(bodies, (2.0, 7.0), [0.4, 0.8, 0.4]), [1.0, 0.5, 0.0])
    np.testing.assert_allclose(scores.curve(bodies[:1], np.array([0.5, 5.0]), [0.4]), 1.0)
    assert scores.interval(np.array([1.0, 0.5, 0.5, 0.0])).startswith("0.50 [")


def test_methods_are_compared_robot_by_robot():
    first, second = np.array([1.0, 0.5, 0.7, 0.2]), np.array([0.9, 0.5, 0.1, 0.0])
    assert scores.better(first, second).startswith("0.88 [") and scores.better(first, first) == "0.50 [0.50, 0.50]"


def told(worths, means, deviations, strike=20):
    """A story of one robot whose segments end every 30 steps."""
    steps = strike + 60 + 30 * len(worths)
    rows_of = lambda values: np.full((steps, 1), np.nan)  # noqa: E731
    ended = Ended(rows_of(0), Forecast(rows_of(0), rows_of(0)), np.zeros((steps, 1), bool))
    for i, (worth, mean, deviation) in enumerate(zip(worths, means, deviations, strict=True)):
        step = strike + 50 + 30 * i
        ended.worth[step], ended.forecast.mean[step], ended.forecast.deviation[step] = worth, mean, deviation
    return SimpleNamespace(ended=ended)


def test_calibration_counts_what_lies_inside_and_which_of_two_was_better():
    story = told([1.0, 0.5, 0.2], [0.9, 0.9, 0.3], [0.1, 0.1, 0.1])
    inside, right, count = scores.calibration([body(0.4)], story)
    assert (inside, count) == (pytest.approx(2 / 3), 3), "the second came out .4 below, four deviations"
    assert right == 1.0, "two pairs of which different things were expected, both in the right order"
    wrong = told([0.2, 1.0], [0.9, 0.3], [0.1, 0.1])
    assert scores.calibration([body(0.4)], wrong)[:2] == (0.0, 0.0)
    assert np.isnan(scores.calibration([body(0.4)], told([], [], []))[0])


def test_who_is_named_is_the_likeliest_of_atlas_and_own_and_policies_count_within_a_tenth():
    atlas = SimpleNamespace(
        damages=("healthy", "leg_rm"), trained_for=("healthy", "leg_rm"), value=np.array([[1.0, 0.2], [0.3, 0.6]])
    )
    belief = np.log(np.array([[[0.1, 0.7, 0.1, 0.1]]] * 60))  # two of the atlas, one put together, none of these
    story = SimpleNamespace(log_belief=belief, policy=np.full((60, 1), 1), twins=[["leg_rf+leg_lm"]])
    lot = rows.Case("leg_rm", (), None)
    assert scores.named(atlas, [lot], [body(0.4)], story, 1.0) == (1.0, 1.0)
    poor = SimpleNamespace(
        log_belief=belief[..., [0, 2, 1, 3]], policy=np.zeros((60, 1), int), twins=[["leg_rf+leg_lm"]]
    )
    assert scores.named(atlas, [lot], [body(0.4)], poor, 1.0) == (0.0, 0.0)
    own = [body(0.4, damage="leg_rf+leg_lm")]
    right, good = scores.named(atlas, [rows.Case("leg_rf+leg_lm", (), None)], own, poor, 1.0)
    assert right == 1.0 and np.isnan(good)


@pytest.mark.slow
def test_every_part_of_what_a_robot_computes_is_timed(atlas, monkeypatch):
    class Apprentice:
        def __init__(self, own):
            assert own is atlas

        def learn(self, damage, policy, steps):
            yield from steps

    monkeypatch.setattr(timing, "Apprentice", Apprentice)
    monkeypatch.setattr(timing, "REPEATS", 1)
    monkeypatch.setattr(timing, "STEPS", 45)
    said = timing.report(atlas)
    for part in ("a control step", "all policies", "96 suppositions", "thinking again", "a lesson of 20,000 steps"):
        assert part in said
