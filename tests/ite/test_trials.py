"""Map-based Bayesian optimisation: the posterior against two other Gaussian processes, and what is tried next."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import tinygp

from srl_jax.ite import trials
from srl_jax.ite.trials import GaitMap, ProcessSettings

RNG = np.random.default_rng(0)
CELLS, CAPACITY = 300, 8
PRIOR = trials.make_map(RNG.uniform(size=(CELLS, 6)), RNG.uniform(0.0, 0.4, CELLS))

posterior = jax.jit(trials.posterior)
suggest = jax.jit(trials.suggest, static_argnames="bonus")
stopped = jax.jit(trials.stopped)


def tried(pairs, capacity: int = CAPACITY) -> trials.TrialState:
    state = trials.init(capacity)
    for index, value in pairs:
        state = trials.record(state, jnp.int32(index), jnp.float32(value))
    return state


def along_axis(fitness, step: float = 0.02) -> GaitMap:
    """Gaits along one axis of descriptor space, `step` apart, then empty cells."""
    values = np.concatenate([np.asarray(fitness), np.full(CELLS - len(fitness), -np.inf)])
    return trials.make_map(np.outer(np.arange(CELLS) * step, np.eye(6)[0]), values)


def numpy_posterior(prior: GaitMap, pairs, settings: ProcessSettings) -> tuple[np.ndarray, np.ndarray]:
    """The textbook's, in f64, with a system of as many rows as there are trials."""
    x, fitness = np.asarray(prior.descriptors, float), np.asarray(prior.fitness, float)
    index = [i for i, _ in pairs]

    def matern(a, b):
        d = np.array([[np.linalg.norm(p - q) for q in b] for p in a]) / settings.length
        return settings.variance * (1 + np.sqrt(5) * d + 5 * d**2 / 3) * np.exp(-np.sqrt(5) * d)

    inverse = np.linalg.inv(matern(x[index], x[index]) + settings.noise * np.eye(len(index)))
    across = matern(x, x[index])
    mean = fitness + across @ inverse @ (np.array([y for _, y in pairs]) - fitness[index])
    variance = settings.variance - np.einsum("nt,tu,nu->n", across, inverse, across)
    return mean, np.sqrt(np.maximum(variance, 0.0))


SOME = [(3, 0.31), (17, -0.02), (200, 0.15), (42, 0.4), (17, 0.01)]  # one gait twice


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("settings", [ProcessSettings(), ProcessSettings(length=0.9, variance=0.05, noise=0.02)])
def test_posterior_equals_numpy_in_double_precision(count, settings):
    mean, deviation = posterior(PRIOR, tried(SOME[:count]), settings)
    expected_mean, expected_deviation = numpy_posterior(PRIOR, SOME[:count], settings)
    np.testing.assert_allclose(mean, expected_mean, atol=1e-4)
    np.testing.assert_allclose(deviation, expected_deviation, atol=1e-4 * np.sqrt(settings.variance) + 1e-4)


def test_posterior_equals_tinygp():
    settings = ProcessSettings(length=0.6, variance=0.3, noise=5e-3)
    index = jnp.array([i for i, _ in SOME])

    @jax.jit
    def reference(surprise):
        matern = tinygp.kernels.Matern52(settings.length, distance=tinygp.kernels.distance.L2Distance())
        process = tinygp.GaussianProcess(settings.variance * matern, PRIOR.descriptors[index], diag=settings.noise)
        found = process.condition(surprise, PRIOR.descriptors, diag=0.0).gp
        return found.loc, found.variance

    loc, variance = reference(jnp.array([y for _, y in SOME]) - PRIOR.fitness[index])
    mean, deviation = posterior(PRIOR, tried(SOME), settings)
    np.testing.assert_allclose(mean - PRIOR.fitness, loc, atol=1e-4)
    np.testing.assert_allclose(deviation**2, variance, atol=1e-4)


def test_without_trials_the_map_is_believed_and_its_best_comes_first():
    mean, deviation = posterior(PRIOR, trials.init(CAPACITY), ProcessSettings(variance=0.25))
    np.testing.assert_array_equal(mean, PRIOR.fitness)
    np.testing.assert_array_equal(deviation, 0.5)
    assert suggest(PRIOR, trials.init(CAPACITY), ProcessSettings()) == np.argmax(PRIOR.fitness)
    index, value = trials.best(trials.init(CAPACITY))
    assert (index, value) == (-1, -np.inf)
    assert not stopped(PRIOR, trials.init(CAPACITY), ProcessSettings())


def test_a_trial_moves_its_gait_to_the_observation_and_neighbours_follow():
    mean, deviation = (x[:60] for x in posterior(along_axis(np.full(60, 0.3)), tried([(0, 0.0)]), ProcessSettings()))
    assert mean[0] == pytest.approx(0.3 * 1e-3 / 1.001, abs=1e-5), "all but the noise's share"
    assert deviation[0] == pytest.approx(np.sqrt(1e-3 / 1.001), rel=1e-2)
    assert np.all(np.diff(mean) > 0) and np.all(np.diff(deviation) > 0), "the nearer, the more"
    assert mean[-1] == pytest.approx(0.3, abs=0.02) and deviation[-1] == pytest.approx(1.0, abs=0.02)


def test_repeated_trials_without_noise_are_no_fault():
    mean, deviation = posterior(PRIOR, tried([(5, 0.1)] * CAPACITY), ProcessSettings(noise=0.0))
    assert np.isfinite(mean).all() and np.isfinite(deviation).all()
    assert mean[5] == pytest.approx(0.1, abs=1e-3)


def test_count_may_be_traced_and_what_lies_beyond_it_means_nothing():
    full = tried([*SOME, (9, 9.0), (10, -9.0)])
    program = jax.jit(lambda count: trials.posterior(PRIOR, full._replace(count=count)))
    for count in range(6):
        clean = posterior(PRIOR, tried(SOME[:count]), ProcessSettings())
        for a, b in zip(program(count), clean, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-5)
    assert program._cache_size() == 1


def test_bonus_is_the_deviation_unless_the_variance_is_asked_for():
    # Of gait 1 little is unknown, so squaring its sigma takes more from it than from gait 2, which promises less.
    prior, state = along_axis([1.0, 1.0, 0.1], step=0.2), tried([(0, 1.0)])
    prior = prior._replace(descriptors=prior.descriptors.at[2].set(5.0))
    sigma = np.asarray(posterior(prior, state, ProcessSettings())[1])[:3]
    kappa = 0.9 / np.mean([1.0 - sigma[1], 1.0 - sigma[1] ** 2])  # between the two at which they would tie
    assert suggest(prior, state, ProcessSettings(kappa=kappa)) == 1
    assert suggest(prior, state, ProcessSettings(kappa=kappa), bonus="variance") == 2


def test_record_best_and_a_full_state():
    state = tried([(4, 0.2), (7, 0.5), (1, 0.3)], capacity=3)
    assert trials.best(state) == (7, 0.5)
    full = trials.record(state, jnp.int32(2), jnp.float32(9.0))
    jax.tree.map(np.testing.assert_array_equal, full, state)
    negative = tried([(4, -0.2)])
    assert trials.best(negative) == (4, np.float32(-0.2)), "unused places, which hold 0, do not win"


def test_a_non_finite_trial_counts_as_zero_and_is_reported():
    state = tried([(4, np.nan), (5, np.inf), (6, 0.1)])
    assert state.faults == 2 and state.count == 3
    np.testing.assert_array_equal(state.observed[:3], np.float32([0.0, 0.0, 0.1]))


def test_stops_at_nine_tenths_of_the_best_expectation():
    prior = along_axis([0.40, 0.36], step=9.0)  # too far apart to tell of each other
    far = ProcessSettings(noise=1e-8)
    assert not stopped(prior, tried([(0, 0.323)]), far), "the other gait promises 0.36: 0.324 would do"
    assert stopped(prior, tried([(0, 0.325)]), far)
    assert not stopped(prior, tried([(0, 0.325)]), far._replace(sufficient=0.95))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: trials.make_map(np.zeros((0, 6)), np.zeros(0)), "empty"),
        (lambda: trials.make_map(np.zeros((3, 6)), np.zeros(4)), r"\(3, 6\) and fitness \(4,\)"),
        (lambda: trials.make_map(np.zeros(6), np.zeros(6)), r"\[N, C\]"),
        (lambda: trials.make_map(np.zeros((2, 6)), np.array([np.nan, 1.0])), "NaN"),
        (lambda: trials.make_map(np.zeros((2, 6)), np.full(2, -np.inf)), "no filled cell"),
        (lambda: trials.make_map(np.full((2, 6), np.nan), np.zeros(2)), "descriptors"),
        (lambda: trials.init(0), "trials is 0"),
        (lambda: trials.suggest(PRIOR, trials.init(1), bonus="sigma"), "'sigma': choose one of deviation, variance"),
        (lambda: trials.posterior(GaitMap(jnp.zeros((2, 6)), jnp.zeros(3)), trials.init(1)), "fitness"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
