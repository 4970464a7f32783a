"""Policies as plain arrays act as they did in jax, at any precision."""

import numpy as np
import pytest

from srl_jax import portable
from tests.portable.made import acting, policy


@pytest.mark.parametrize("layer_norm", [True, False])
def test_it_acts_as_in_jax(layer_norm):
    own, student = acting(layer_norm)
    seen = np.random.default_rng(0).normal(size=(50, 7)).astype(np.float32)
    expected = student(seen)
    np.testing.assert_allclose(own(seen), expected, atol=1e-5)
    np.testing.assert_allclose(own(seen[3]), expected[3], atol=1e-5)
    assert np.std(expected) > 0.1


def test_another_observation_is_refused():
    with pytest.raises(ValueError, match=r"shape \(6,\): this policy reads 7 numbers, clock \(2\), joints \(5\)"):
        policy()(np.zeros(6))


def test_weights_have_names():
    own = policy(layer_norm=False, hidden=(4,))
    assert list(own.weights) == ["0/kernel", "0/bias", "1/kernel", "1/bias"]
    assert (own.observation_size, own.action_size) == (7, 3)
    assert set(policy().weights) - set(own.weights) == {
        *("0/scale", "0/shift", "1/scale", "1/shift", "2/kernel", "2/bias")
    }


@pytest.mark.parametrize(("precision", "most"), [("full", 0.0), ("half", 5e-4), ("coarse", 0.5 / 256 + 5e-4)])
def test_rounding_changes_weights_by_so_much(precision, most):
    own = policy()
    kept = portable.rounded(own, precision)
    off = [np.abs(kept.weights[name] - own.weights[name]).max() for name in own.weights]
    assert max(off) <= most and (max(off) > 0.0) == (most > 0.0)
    if precision == "coarse":
        assert all((256.0 * value == np.round(256.0 * value)).all() for value in kept.weights.values())


def test_a_damage_is_picked():
    each = [policy(damage="leg_rm"), policy(damage="healthy"), policy(damage="leg_rm")]
    assert portable.pick(each, ("leg_rm",), "a run") == [each[0], each[2]]
    assert portable.pick(each, (), "a run") == each
    with pytest.raises(ValueError, match="damage is 'leg_lf': a run has policies for leg_rm, healthy"):
        portable.pick(each, ("healthy", "leg_lf"), "a run")
