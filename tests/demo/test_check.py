"""The check of what a page will show: policies that walk on after a cut in mid-walk, and such that do not."""

import dataclasses

import numpy as np
import pytest

from srl_jax.atlas import file
from srl_jax.atlas.stored import policies
from srl_jax.demo import check


@pytest.fixture(scope="module")
def atlas():
    return policies(file.load())


def still(policy):
    """The policy with a last layer that asks for the stance."""
    *hidden, last = policy.layers
    return dataclasses.replace(policy, layers=(*hidden, last.map(np.zeros_like)))


def test_a_policy_of_the_atlas_walks_on_and_one_that_stands_does_not(atlas):
    walked = check.after_cut(atlas["leg_lf"], atlas["healthy"])
    assert walked.speed > 0.4 and not walked.fell
    stood = check.after_cut(still(atlas["leg_lf"]), None)
    assert abs(stood.speed) < 0.05 and not stood.fell


def test_it_says_how_many_walk_and_who_does_not(atlas):
    lame = still(atlas["leg_rm"])
    said = check.said([atlas["leg_lf"], lame], atlas["healthy"])
    assert said.startswith("1 of 2 policies walk on for 15 s after a cut in mid-walk (median 0.")
    assert said.endswith(" m/s, not so srl for leg_rm).")
    assert "not so" not in check.said([atlas["leg_lf"]], atlas["healthy"])
