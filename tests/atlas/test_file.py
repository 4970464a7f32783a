"""The file of an atlas: what is saved is loaded, at half precision; what is no atlas is said to be none."""

import jax
import numpy as np
import pytest

from srl_jax.atlas import file


def test_what_is_saved_is_loaded(atlas, tmp_path):
    file.save(tmp_path / "atlas.npz", atlas)
    found = file.load(tmp_path / "atlas.npz")
    assert (found.damages, found.trained_for, found.about) == (atlas.damages, atlas.trained_for, atlas.about)
    for name in ("speed", "falls", "whitening"):
        np.testing.assert_array_equal(getattr(found, name), getattr(atlas, name))
    assert jax.tree.structure(found.actors) == jax.tree.structure(atlas.actors)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-4), found.actors, atlas.actors)
    file.save(tmp_path / "whole.npz", atlas, half=False)
    jax.tree.map(np.testing.assert_array_equal, file.load(tmp_path / "whole.npz").actors, atlas.actors)


def test_a_fall_costs_all_of_a_policys_worth(atlas):
    fallen = atlas._replace(falls=np.where(np.eye(4, k=1) > 0, 1.0, atlas.falls))
    np.testing.assert_allclose(atlas.value[0], [1.0, 0.2, 0.2, 0.2], rtol=1e-6)
    np.testing.assert_allclose(fallen.value[0], [1.0, 0.0, 0.2, 0.2], rtol=1e-6)


def test_what_is_no_atlas_gets_a_sentence(atlas, tmp_path):
    with pytest.raises(ValueError, match=r"none.npz does not exist: make an atlas"):
        file.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("no atlas")
    with pytest.raises(ValueError, match=r"text.npz cannot be read as an atlas"):
        file.load(tmp_path / "text.npz")
    file.save(tmp_path / "odd.npz", atlas._replace(speed=atlas.speed[:2]))
    with pytest.raises(ValueError, match="not a row a policy"):
        file.load(tmp_path / "odd.npz")
