"""Sweeps and ranges: what a field accepts stands in its type, and lanes get their own numbers."""

import math
from dataclasses import dataclass
from typing import Annotated

import jax
import numpy as np
import pytest

from srl_jax.agents import hyper
from srl_jax.agents.settings import DDPGConfig, SRLConfig
from srl_jax.agents.sweep import AgentSettings, Count, NotNegative, Positive, Range, Share, Sweep, first_values


@dataclass(frozen=True)
class Small(AgentSettings):
    """One field of each kind."""

    free: Sweep = (1.0,)
    share: Share = (0.5,)
    rate: NotNegative = (0.0,)
    scale: Positive = (2.0,)
    size: Count = 3
    low: Annotated[Sweep, Range(0.0, 0.9)] = (0.1,)
    name: str = "x"


def test_fields_that_may_be_swept_are_the_hyper_parameters_in_order():
    kind = hyper.hyper_type(Small)
    assert kind._fields == ("free", "share", "rate", "scale", "low") and kind.__name__ == "SmallHyper"
    assert hyper.hyper_type(Small) is kind, "a pytree's type is one and the same"
    assert not hasattr(hyper.from_config(DDPGConfig()), "beta"), "no agent carries another's numbers"


def test_a_single_number_stands_for_a_sweep_of_one():
    assert Small(share=1, scale=3.5).share == (1.0,) and Small(scale=3.5).scale == (3.5,)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"share": (0.5, 1.1)}, "mine.share is 0.5,1.1: it must lie between 0 and 1."),
        ({"rate": (-1e-9,)}, "mine.rate is -1e-09: it must not be negative."),
        ({"scale": (0.0,)}, "mine.scale is 0: it must be positive."),
        ({"size": 0}, "mine.size is 0: it must be at least 1."),
        ({"low": (0.95,)}, "mine.low is 0.95: it must lie between 0 and 0.9."),
        ({"rate": (math.nan,)}, "mine.rate is nan: it must not be negative."),
        ({"rate": (math.inf,)}, "mine.rate is inf: it must not be negative."),
        ({"share": ()}, "mine.share is empty: it must lie between 0 and 1."),
    ],
)
def test_a_number_out_of_its_range_is_refused_by_name(wrong, said):
    with pytest.raises(ValueError) as caught:
        Small(**wrong).check("mine")
    assert str(caught.value) == said


def test_the_ends_of_a_range_are_accepted():
    Small(share=(0.0, 1.0), rate=(0.0,), low=(0.9,), size=1).check("mine")


def test_variants_are_the_product_of_the_sweeps():
    config = SRLConfig(beta=(0.5, 0.6), tau=(0.01, 0.02, 0.03))
    assert list(hyper.variants(config)) == [{"tau": t, "beta": b} for t in (0.01, 0.02, 0.03) for b in (0.5, 0.6)]
    assert list(hyper.variants(DDPGConfig())) == [{}]
    assert first_values(config) == SRLConfig(beta=(0.5,), tau=(0.01,))


def test_lanes_get_the_values_they_chose_and_the_first_ones_otherwise():
    config = SRLConfig(beta=(0.5, 0.6))
    one = hyper.from_config(config, beta=0.6)
    assert one.beta == pytest.approx(0.6) and one.psi == pytest.approx(0.99)
    assert all(value.dtype == "float32" and value.shape == () for value in jax.tree.leaves(one))
    rows = hyper.stack(config, [{"beta": 0.6}, {}, {"psi": 0.5}])
    np.testing.assert_allclose(rows.beta, [0.6, 0.5, 0.5], rtol=1e-6)
    np.testing.assert_allclose(rows.psi, [0.99, 0.99, 0.5], rtol=1e-6)
    assert jax.tree.structure(rows) == jax.tree.structure(one)
