"""Naming the damage from traces: against NumPy loops, and on toy robots whose answer is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.ite import selfmodel

KEY = jax.random.key(0)
RNG = np.random.default_rng(0)
D, P, T, F = 5, 4, 6, 3
PREDICTED = jnp.asarray(RNG.normal(size=(D, P, T, F)), jnp.float32)
SCALES = jnp.array([0.5, 1.0, 2.0])
UNIFORM = jnp.full(D, -np.log(D))

update = jax.jit(selfmodel.update)
distances = jax.jit(selfmodel.distances)
disagreement = jax.jit(selfmodel.disagreement)
next_probe = jax.jit(selfmodel.next_probe)
compiled = jax.jit(selfmodel.identify, static_argnames=("probes", "choice"))


def identify(predicted, observed, key=KEY, *, choice="disagreement", log_prior=UNIFORM, correlation=10.0):
    """All motions, always the same program; what fewer motions tell are the first rows."""
    given = {"log_prior": log_prior, "correlation": correlation, "choice": choice}
    return compiled(predicted, observed, SCALES, key, probes=P, **given)


def logs(*probabilities) -> jax.Array:
    return jnp.log(jnp.array(probabilities))


def weighted_variance(belief: np.ndarray, predicted: np.ndarray) -> np.ndarray:
    """Variance over hypotheses, summed over steps and senses, in sigmas: f64[P]."""
    x = np.asarray(predicted, float) / np.asarray(SCALES, float)
    mean = np.einsum("d,dptf->ptf", belief, x)
    return np.einsum("d,dptf->p", belief, (x - mean) ** 2)


def test_log_likelihood_equals_a_loop():
    observed, correlation = np.asarray(RNG.normal(size=(T, F)), np.float32), 4.0
    expected = np.zeros(D)
    for d in range(D):
        for t in range(T):
            for f in range(F):
                expected[d] -= (observed[t, f] - float(PREDICTED[d, 1, t, f])) ** 2 / (2 * float(SCALES[f]) ** 2)
    found = selfmodel.log_likelihood(jnp.asarray(observed), PREDICTED[:, 1], SCALES, correlation)
    np.testing.assert_allclose(found, expected / correlation, rtol=1e-5)


def test_bayes_rule():
    posterior = update(logs(0.5, 0.3, 0.2), logs(0.1, 0.2, 0.4))
    np.testing.assert_allclose(np.exp(posterior), np.array([0.05, 0.06, 0.08]) / 0.19, rtol=1e-5)


def test_overwhelming_evidence_neither_overflows_nor_forgets():
    first = update(UNIFORM, jnp.array([0.0, -1e6, -2e6, -2e6, -2e6]))
    np.testing.assert_allclose(np.exp(first), [1, 0, 0, 0, 0], atol=1e-7)
    second = update(first, jnp.array([-3e6, -1e6, -3e6, -3e6, -3e6]))
    np.testing.assert_allclose(np.exp(second), [0, 1, 0, 0, 0], atol=1e-7)
    impossible = update(first, jnp.full(D, -np.inf))
    np.testing.assert_array_equal(impossible, first)


def test_hypotheses_that_cannot_be_simulated_lose_but_poison_nothing():
    broken = PREDICTED.at[2, :, 3, 1].set(jnp.nan)
    observed = PREDICTED[1]
    found = identify(broken, observed)
    assert np.isneginf(found.log_posterior[:, 2]).all()
    np.testing.assert_allclose(np.exp(found.log_posterior).sum(1), 1.0, rtol=1e-5)
    assert (found.log_posterior.argmax(1) == 1).all()
    kept = np.arange(D) != 2
    np.testing.assert_allclose(
        distances(broken, SCALES)[:, kept][:, :, kept], distances(PREDICTED, SCALES)[:, kept][:, :, kept], rtol=1e-5
    )
    np.testing.assert_array_equal(distances(broken, SCALES)[:, 2], 0.0)
    mute = identify(PREDICTED, jnp.full((P, T, F), jnp.nan))
    np.testing.assert_allclose(np.exp(mute.log_posterior), 1 / D, rtol=1e-5)


@pytest.mark.parametrize("belief", [np.full(D, 1 / D), np.array([0.5, 0.25, 0.0, 0.05, 0.2])])
def test_disagreement_is_the_variance_over_belief(belief):
    found = disagreement(jnp.log(jnp.asarray(belief)), distances(PREDICTED, SCALES))
    np.testing.assert_allclose(found, weighted_variance(belief, PREDICTED), rtol=1e-5)


def test_disagreement_keeps_its_digits_where_belief_is_nearly_certain():
    # Two hypotheses that are almost one, far from zero: a difference of second moments would leave rounding errors.
    near = PREDICTED.at[1].set(PREDICTED[0] + 1e-2 * PREDICTED[2]) + 1e3
    belief = np.array([0.6, 0.4, 0.0, 0.0, 0.0])
    found = disagreement(jnp.log(jnp.asarray(belief, jnp.float32)), distances(near, SCALES))
    np.testing.assert_allclose(found, weighted_variance(belief, near), rtol=1e-3)


def test_next_probe_is_the_one_that_tells_and_never_a_used_one():
    telling = jnp.tile(PREDICTED[:1, :1], (D, P, 1, 1)).at[:, 2].multiply(jnp.arange(D)[:, None, None])
    telling = telling.at[:, 1].add(0.1 * jnp.arange(D)[:, None, None])
    pairs = distances(telling, SCALES)
    used = jnp.zeros(P, bool)
    assert next_probe(UNIFORM, pairs, used) == 2
    assert next_probe(UNIFORM, pairs, used.at[2].set(True)) == 1
    rest = used.at[jnp.array([1, 2])].set(True)
    assert next_probe(UNIFORM, pairs, rest) in (0, 3), "even where none of them tells anything"


def test_next_probe_looks_only_at_hypotheses_still_believed():
    # Probe 0 tells 0 from all others, probe 1 tells 3 from 4, by less.
    told = jnp.zeros((D, P, T, F)).at[0, 0].set(5.0).at[3, 1].set(1.0)
    pairs = distances(told, SCALES)
    assert next_probe(UNIFORM, pairs, jnp.zeros(P, bool)) == 0
    assert next_probe(logs(0, 0, 0, 0.5, 0.5), pairs, jnp.zeros(P, bool)) == 1


def test_identification_equals_its_steps_taken_one_by_one():
    observed = PREDICTED[3] + 2.0 * jnp.asarray(RNG.normal(size=(P, T, F)), jnp.float32)
    log_prior = logs(0.3, 0.1, 0.2, 0.15, 0.25)
    found = identify(PREDICTED, observed, log_prior=log_prior + 300.0, correlation=5.0)
    belief, used = np.exp(np.asarray(log_prior, float)), []
    for n in range(P):
        score = weighted_variance(belief, PREDICTED)
        score[used] = -1.0
        used.append(int(score.argmax()))
        errors = (np.asarray(PREDICTED[:, used[-1]], float) - np.asarray(observed[used[-1]])) / np.asarray(SCALES)
        belief = belief * np.exp(-0.1 * (errors**2).sum((1, 2)))
        belief /= belief.sum()
        np.testing.assert_allclose(np.exp(found.log_posterior[n]), belief, rtol=1e-3, atol=1e-6)
    assert np.asarray(found.probe).tolist() == used


def test_only_motions_that_were_made_are_looked_at():
    observed = PREDICTED[3]
    found = identify(PREDICTED, observed)
    made = found.probe[:2]
    again = identify(PREDICTED, jnp.full_like(observed, 1e9).at[made].set(observed[made]))
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a[:2], b[:2]), found, again)
    fewer = jax.jit(lambda o: selfmodel.identify(PREDICTED, o, SCALES, KEY, probes=2))(observed)
    np.testing.assert_array_equal(fewer.probe, made)
    np.testing.assert_allclose(fewer.log_posterior, found.log_posterior[:2], rtol=1e-5)


@pytest.mark.parametrize("choice", selfmodel.CHOICES)
def test_the_truth_is_found_and_no_motion_made_twice(choice):
    for truth in range(D):
        found = identify(PREDICTED, PREDICTED[truth], choice=choice, correlation=1.0)
        assert found.log_posterior[-1].argmax() == truth and np.exp(found.log_posterior[-1, truth]) > 0.99
        assert sorted(np.asarray(found.probe).tolist()) == list(range(P))


def test_random_motions_depend_on_the_key_alone():
    runs = [identify(PREDICTED, PREDICTED[0], key, choice="random") for key in jax.random.split(KEY, 20)]
    firsts = {int(run.probe[0]) for run in runs}
    assert firsts == set(range(P))


def test_damages_that_look_alike_share_their_probability():
    twins = PREDICTED.at[4, 0].set(PREDICTED[3, 0])  # alike in motion 0, not in the others
    belief = selfmodel.update(UNIFORM, selfmodel.log_likelihood(twins[3, 0], twins[:, 0], SCALES, 0.1))
    np.testing.assert_allclose(np.exp(belief), [0, 0, 0, 0.5, 0.5], atol=1e-5)
    assert next_probe(belief, distances(twins, SCALES), jnp.zeros(P, bool)) != 0
    same = PREDICTED.at[4].set(PREDICTED[3])  # alike in all
    end = identify(same, same[3], correlation=0.1).log_posterior[-1]
    np.testing.assert_allclose(np.exp(end), [0, 0, 0, 0.5, 0.5], atol=1e-5)
    assert selfmodel.top(end, jnp.int32(3), 1) == selfmodel.top(end, jnp.int32(4), 1) == 0.5


def noisy_robots(count: int, noise: float) -> tuple[jax.Array, jax.Array]:
    """True damages i32[count] and what the robots feel f32[count, P, T, F]."""
    truth = jnp.asarray(RNG.integers(D, size=count))
    return truth, PREDICTED[truth] + noise * jnp.asarray(RNG.normal(scale=SCALES, size=(count, P, T, F)), jnp.float32)


def test_belief_is_calibrated_where_the_noise_is_as_assumed():
    truth, observed = noisy_robots(4000, 4.0)
    one = lambda traces: selfmodel.identify(PREDICTED, traces, 4.0 * SCALES, KEY, probes=2, correlation=1.0)  # noqa: E731
    belief = np.exp(jax.jit(jax.vmap(one))(observed).log_posterior)
    for after in range(2):
        sure, right = belief[:, after].max(1), belief[:, after].argmax(1) == np.asarray(truth)
        error = float(np.sqrt(np.mean(sure * (1 - sure)) / len(sure)))
        assert 0.3 < right.mean() < 0.9, "the case is neither hopeless nor plain"
        assert right.mean() == pytest.approx(sure.mean(), abs=4 * error)


def test_robots_and_seeds_under_vmap_equal_one_by_one():
    _, observed = noisy_robots(6, 1.0)
    keys = jax.random.split(KEY, 6)
    one = lambda traces, key: selfmodel.identify(PREDICTED, traces, SCALES, key, probes=P, choice="random")  # noqa: E731
    wide = jax.jit(jax.vmap(jax.vmap(one)))(observed.reshape(2, 3, P, T, F), keys.reshape(2, 3))
    for lane in range(6):
        own = identify(PREDICTED, observed[lane], keys[lane], choice="random")
        np.testing.assert_array_equal(own.probe, wide.probe.reshape(6, -1)[lane])
        np.testing.assert_allclose(own.log_posterior, wide.log_posterior.reshape(6, P, D)[lane], rtol=1e-4, atol=1e-4)


def test_given_distances_change_nothing():
    pairs = distances(PREDICTED, SCALES)
    own = identify(PREDICTED, PREDICTED[2])
    given = compiled(PREDICTED, PREDICTED[2], SCALES, KEY, probes=P, pairs=pairs)
    np.testing.assert_array_equal(own.probe, given.probe)
    np.testing.assert_allclose(own.log_posterior, given.log_posterior, rtol=1e-6)


def test_scales_are_the_spread_of_starts_and_sensors():
    repeated = PREDICTED + jnp.array([0.3, 0.0, 4.0])[None, None, None]
    sensors = jnp.array([0.4, 0.2, 3.0])
    np.testing.assert_allclose(selfmodel.residual_scales(PREDICTED, repeated, sensors), [0.5, 0.2, 5.0], rtol=1e-5)
    failed = repeated.at[0, 0, 0, 0].set(jnp.nan)
    np.testing.assert_allclose(selfmodel.residual_scales(PREDICTED, failed, sensors), [0.5, 0.2, 5.0], rtol=1e-5)


@pytest.mark.parametrize(
    ("truth", "k", "share"), [(0, 1, 0), (1, 1, 1), (2, 1, 0), (2, 2, 1 / 3), (0, 3, 2 / 3), (4, 4, 1), (3, 4, 0)]
)
def test_top_breaks_ties_by_lot(truth, k, share):
    belief = logs(0.2, 0.35, 0.2, 0.05, 0.2)
    assert float(selfmodel.top(belief, jnp.int32(truth), k)) == pytest.approx(share)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"choice": "greedy"}, "'greedy': choose one of disagreement, random"),
        ({"probes": 0}, "probes is 0; accepted are 1 to 4"),
        ({"probes": 5}, "probes is 5"),
        ({"predicted": jnp.zeros((0, P, T, F))}, r"predicted has shape \(0, 4, 6, 3\)"),
        ({"observed": jnp.zeros((P, T + 1, F))}, r"observed \(4, 7, 3\)"),
        ({"scales": jnp.ones(F + 1)}, r"scales \(4,\)"),
        ({"log_prior": jnp.zeros(D + 1)}, r"log_prior \(6,\)"),
    ],
)
def test_bad_input_is_named(changed, message):
    given = {"predicted": PREDICTED, "observed": PREDICTED[0], "scales": SCALES, "key": KEY, "probes": 2, **changed}
    with pytest.raises(ValueError, match=message):
        selfmodel.identify(**given)


def test_bad_scales_are_named():
    with pytest.raises(ValueError, match="sensor_noise"):
        selfmodel.residual_scales(PREDICTED, PREDICTED, jnp.ones(F + 1))
