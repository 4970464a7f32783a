"""An atlas' policies, taken home, are those that its robots walk by."""

import jax
import numpy as np

from srl_jax.atlas import file, stored
from srl_jax.portable.policy import layers


def test_an_atlas_gives_a_policy_for_each_damage():
    atlas = file.load()
    policies = stored.policies(stored.read())
    assert tuple(policies) == atlas.trained_for
    own = layers(jax.tree.map(lambda leaf: leaf[5], atlas.actors))
    for found, expected in zip(policies[atlas.trained_for[5]].layers, own, strict=True):
        np.testing.assert_array_equal(found.kernel, expected.kernel)
    assert policies["leg_rm"].about["observation"][0] == ("clock: sin, cos", 2)


def test_of_several_policies_for_a_damage_the_first_is_taken(atlas):
    named = atlas._replace(trained_for=("healthy", "leg_rm", "leg_rm", "healthy"), about=atlas.about | NAMES)
    found = stored.policies(named)
    assert list(found) == ["healthy", "leg_rm"]
    bias = atlas.actors["params"]["Torso_0"]["Dense_0"]["kernel"]
    np.testing.assert_array_equal(found["leg_rm"].layers[0].kernel, bias[1])


NAMES = {"command": "a test", "versions": {}}
