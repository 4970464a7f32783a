"""Statistics against plain loops, SciPy and known values."""

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, trim_mean

from srl_jax import statistics

RNG = np.random.default_rng(0)
SCORES = RNG.normal(size=(10, 6))


def test_iqm_is_the_mean_of_the_middle_half():
    assert statistics.iqm([100.0, 1, 2, 3, 4, 5, 6, -50]) == pytest.approx(np.mean([2, 3, 4, 5]))
    by_row = [trim_mean(row, 0.25) for row in SCORES]
    np.testing.assert_allclose(statistics.iqm(SCORES, axis=1), by_row)
    assert statistics.iqm([1.0, 2, 3, np.inf]) == 2.5
    assert statistics.iqm([1.0, np.inf, np.inf, np.inf]) == np.inf


@pytest.mark.parametrize("statistic", [statistics.iqm, np.mean, np.median])
def test_interval_equals_a_plain_loop(statistic):
    low, high = statistics.stratified_interval(SCORES, statistic, resamples=201, seed=3)
    index = np.random.default_rng(3).integers(10, size=(201, 10, 6))
    drawn = [np.concatenate([SCORES[index[r, :, c], c] for c in range(6)]) for r in range(201)]
    ordered = sorted(float(statistic(x)) for x in drawn)
    assert (low, high) == pytest.approx((ordered[5], ordered[195]))


def test_interval_never_mixes_conditions():
    scores = np.tile([0.0, 10.0, 20.0], (5, 1))
    assert statistics.stratified_interval(scores, np.mean) == (10.0, 10.0)


def test_interval_covers_at_about_its_nominal_rate():
    offsets, rng = np.linspace(-0.3, 0.3, 6), np.random.default_rng(7)
    hits = 0
    for trial in range(400):
        low, high = statistics.stratified_interval(rng.normal(offsets, 1.0, (10, 6)), resamples=400, seed=trial)
        hits += low <= 0.0 <= high
    assert 0.90 <= hits / 400 <= 0.985


def test_interval_keeps_what_was_never_reached():
    low, high = statistics.stratified_interval(np.where(SCORES > 0.3, np.inf, 1.0))
    assert low >= 1.0 and high == np.inf


def test_curve_equals_the_interval_at_each_step():
    values = RNG.normal(size=(4, 10, 6))
    centre, low, high = statistics.iqm_curve(values, resamples=200, seed=1)
    for t in range(4):
        assert centre[t] == pytest.approx(statistics.iqm(values[t]))
        assert (low[t], high[t]) == statistics.stratified_interval(values[t], resamples=200, seed=1)


def test_many_intervals_are_those_of_each(monkeypatch):
    monkeypatch.setattr(statistics, "DRAWN_AT_ONCE", 2 * 100 * 60)  # two tables at once
    values = RNG.normal(size=(5, 10, 6))
    found = statistics.stratified_intervals(values, np.mean, resamples=100, seed=2)
    for table, ends in zip(values, found, strict=True):
        assert tuple(ends) == statistics.stratified_interval(table, np.mean, resamples=100, seed=2)


def test_single_lane_collapses_the_band():
    centre, low, high = statistics.iqm_curve(np.arange(3.0)[:, None, None])
    np.testing.assert_array_equal([centre, low, high], [[0, 1, 2]] * 3)


def test_improvement_is_the_mean_mann_whitney_statistic():
    x, y = RNG.integers(0, 4, (10, 6)).astype(float), RNG.integers(0, 5, (8, 6)).astype(float)
    expected = np.mean([mannwhitneyu(x[:, c], y[:, c]).statistic / 80 for c in range(6)])
    point, low, high = statistics.probability_of_improvement(x, y)
    assert point == pytest.approx(expected)
    assert low < point < high
    assert statistics.probability_of_improvement(y, x).point == pytest.approx(1 - expected)
    assert statistics.probability_of_improvement(x, x).point == pytest.approx(0.5)
    assert statistics.probability_of_improvement(x + 9, y) == pytest.approx((1, 1, 1))


def test_improvement_interval_agrees_with_a_plain_bootstrap():
    x, y, rng = SCORES + 0.4, RNG.normal(size=(8, 6)), np.random.default_rng(5)
    drawn = []
    for _ in range(1000):
        pairs = [(rng.choice(x[:, c], 10), rng.choice(y[:, c], 8)) for c in range(6)]
        drawn.append(np.mean([np.mean(a[:, None] > b) for a, b in pairs]))
    _, low, high = statistics.probability_of_improvement(x, y)
    np.testing.assert_allclose([low, high], np.quantile(drawn, [0.025, 0.975]), atol=0.02)


def test_profile_counts_runs_above_each_threshold():
    taus = np.sort(np.append(RNG.normal(size=20), SCORES[0, 0]))
    expected = [np.mean(tau < SCORES) for tau in taus]
    np.testing.assert_allclose(statistics.performance_profile(SCORES, taus), expected)


def test_area_is_the_mean_height():
    steps, values = np.array([0.0, 100, 400]), RNG.normal(size=(3, 2, 5))
    expected = (50 * (values[0] + values[1]) + 150 * (values[1] + values[2])) / 400
    np.testing.assert_allclose(statistics.area_under_curve(steps, values), expected)
    np.testing.assert_allclose(statistics.area_under_curve(steps, np.full(3, 0.7)), 0.7)
    np.testing.assert_allclose(statistics.area_under_curve([0.0], values[:1]), values[0])


def test_threshold_is_the_first_evaluation_at_or_above_it():
    values = np.array([[0.0, 5, 0], [2, 0, 0], [1, 0, 0], [3, 5, 1.9]])
    found = statistics.steps_to_threshold([0, 10, 20, 30], values, 2.0)
    np.testing.assert_array_equal(found, [10, 0, np.inf])
    found = statistics.steps_to_threshold([0, 10, 20, 30], values, [2.5, np.inf, 1.9])
    np.testing.assert_array_equal(found, [30, np.inf, 30])


@pytest.mark.parametrize(
    "call",
    [
        statistics.iqm,
        statistics.stratified_interval,
        lambda x: statistics.iqm_curve(x[None]),
        lambda x: statistics.probability_of_improvement(x, SCORES),
        lambda x: statistics.probability_of_improvement(SCORES, x),
        lambda x: statistics.performance_profile(x, [0.0]),
        lambda x: statistics.area_under_curve(np.arange(10), x),
        lambda x: statistics.steps_to_threshold(np.arange(10), x, 0.0),
    ],
)
def test_nan_is_refused(call):
    scores = SCORES.copy()
    scores[4, 2] = np.nan
    with pytest.raises(ValueError, match="holds 1 NaN among 60 values"):
        call(scores)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: statistics.iqm([]), "is empty"),
        (lambda: statistics.stratified_interval(SCORES[0]), "must have 2 axes"),
        (lambda: statistics.stratified_interval(SCORES, confidence=95), "confidence is 95"),
        (lambda: statistics.stratified_interval(SCORES, resamples=0), "resamples is 0"),
        (lambda: statistics.probability_of_improvement(SCORES, SCORES[:, :2]), "6 conditions and y has 2"),
        (lambda: statistics.area_under_curve([0, 0], [1, 2]), "increase strictly"),
        (lambda: statistics.steps_to_threshold([0, 1], [1, 2, 3], 0), "first axis must hold the 2 steps"),
        (lambda: statistics.steps_to_threshold([0, 1], [[1, 2], [3, 4]], [0]), r"threshold has shape \(1,\)"),
        (lambda: statistics.probability_of_improvement(SCORES, SCORES, resamples=0), "resamples is 0"),
    ],
)
def test_wrong_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
