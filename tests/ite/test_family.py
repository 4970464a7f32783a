"""The gait family: against a plain transcription, sample by sample, and what its reference tripod must show."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env.anatomy import LEGS
from srl_jax.ite import family

RNG = np.random.default_rng(0)
LEVELS = RNG.integers(0, 21, (20, 36)).astype(np.float32) / 20
table = jax.jit(jax.vmap(family.table))
action = jax.jit(jax.vmap(family.action, in_axes=(0, None)))


def signal(amplitude, phase, duty):
    """One control signal of the literature's controller: 100 samples, in plain Python."""
    square = [amplitude if i < round(100 * duty) else -amplitude for i in range(100)]
    weight = {d: np.exp(-d * d / (2 * 3.0**2)) for d in range(-10, 11)}
    smooth = [sum(w * square[(i + d) % 100] for d, w in weight.items()) / sum(weight.values()) for i in range(100)]
    start = round(100 * phase)
    return [smooth[(i + start) % 100] for i in range(100)]


def test_table_against_the_published_recipe():
    numbered = ("rf", "rm", "rr", "lr", "lm", "lf")
    for parameters, found in zip(LEVELS[:4], table(LEVELS[:4]), strict=True):
        for number, leg in enumerate(numbered):
            coxa, femur = parameters[6 * number :][:3], parameters[6 * number + 3 :][:3]
            columns = 3 * LEGS.index(leg) + np.arange(3)
            expected = np.stack([signal(*coxa), signal(*femur), -np.array(signal(*femur))], axis=1)
            np.testing.assert_allclose(found[:, columns], expected, atol=1e-5)


def test_actions_are_the_tables_rows_and_linear_between_them():
    tables = np.asarray(table(LEVELS))
    for k in (0, 7, 99):
        np.testing.assert_allclose(action(LEVELS, k / 100), tables[:, k], atol=1e-5)
        between = 0.7 * tables[:, k] + 0.3 * tables[:, (k + 1) % 100]
        np.testing.assert_allclose(action(LEVELS, (k + 0.3) / 100), between, atol=1e-5)
        np.testing.assert_allclose(action(LEVELS, 3 + k / 100), tables[:, k], atol=1e-4)


def test_at_the_control_rate_every_fifth_sample_is_played():
    tables, phase = table(LEVELS), jnp.zeros(())
    for step in range(40):
        np.testing.assert_allclose(action(LEVELS, phase), tables[:, 5 * step % 100], atol=1e-4)
        phase = jnp.mod(phase + 1.0 / 20.0, 1.0)  # as the environment's clock


def test_actions_stay_in_range_and_reach_it():
    found = np.asarray(table(RNG.uniform(size=(200, 36)).astype(np.float32)))
    assert np.all(np.abs(found) <= 1.0 + 1e-6)
    full = np.asarray(family.table(jnp.asarray(family.REFERENCE)))
    assert full[:, ::3].max() == pytest.approx(1.0, abs=1e-5) and full[:, ::3].min() == pytest.approx(-1.0, abs=1e-5)


def test_no_amplitude_is_the_stance_and_full_duty_holds_still():
    still = np.zeros(36, np.float32)
    assert not np.any(family.table(still))
    held = np.tile(np.float32([0.5, 0.3, 1.0]), 12)
    found = np.asarray(family.table(held)).reshape(100, 6, 3)
    np.testing.assert_allclose(found, np.broadcast_to([0.5, 0.5, -0.5], found.shape), atol=1e-6)


def test_every_hundredth_of_duty_and_phase_is_its_own_sample():
    hundredths = np.arange(101)
    gaits = np.zeros((101, 36), np.float32)
    gaits[:, 0], gaits[:, 2] = 1.0, hundredths / 100
    np.testing.assert_allclose(np.sum(table(gaits)[:, :, 0], axis=1), 2 * hundredths - 100, atol=1e-3)
    gaits[:, 1], gaits[:, 2] = hundredths / 100, 0.4
    unshifted = np.asarray(table(gaits[:1]))[0, :, 0]
    for k, found in zip(hundredths, np.asarray(table(gaits)), strict=True):
        np.testing.assert_allclose(found[:, 0], np.roll(unshifted, -k), atol=1e-6)


def test_phase_of_a_whole_cycle_is_none():
    gaits = LEVELS.copy()
    gaits[:, 1::3] = 0.0
    turned = gaits.copy()
    turned[:, 1::3] = 1.0
    np.testing.assert_array_equal(table(gaits), table(turned))


def test_reference_lifts_its_tripods_in_antiphase():
    found = np.asarray(family.table(jnp.asarray(family.REFERENCE))).reshape(100, 6, 3)
    lift = {leg: found[:, LEGS.index(leg), 1] for leg in LEGS}
    for one, other in (("rf", "rm"), ("rr", "lf"), ("lm", "lr")):
        np.testing.assert_allclose(lift[one], np.roll(lift[other], 50), atol=1e-6)
    for tripod in (("rf", "rr", "lm"), ("rm", "lf", "lr")):
        for leg in tripod:
            np.testing.assert_array_equal(lift[leg], lift[tripod[0]])
    for leg in LEGS:  # a foot swings forward while it is lifted: counter-clockwise on the right, clockwise on the left
        stride = np.gradient(found[:, LEGS.index(leg), 0]) * (1 if leg[0] == "r" else -1)
        assert np.sum(stride * lift[leg]) > 0.0


def test_wrong_number_of_parameters_is_refused():
    with pytest.raises(AssertionError):
        family.action(jnp.zeros(35), 0.0)
