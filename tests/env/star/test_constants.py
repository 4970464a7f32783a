"""How a model is arranged by links and legs, and its numbers taken there and back."""

import jax.numpy as jnp
import numpy as np
import pytest

from srl_jax.env.anatomy import LEGS, SEGMENTS
from srl_jax.env.model import load_model
from srl_jax.env.star.body import NO_SPHERE, body, by_id, by_link
from srl_jax.env.star.constants import FILLER, NO_LIMIT, constant, read
from tests.env.star.robots import crab, quadruped


def test_the_hexapod_is_six_legs_of_three_links():
    model, star = load_model(), read(load_model())
    assert star.legs == 6 and len(star.links) == 3
    for leg, where in enumerate(LEGS):
        for link, segment in enumerate(SEGMENTS):
            assert model.body(star.ids.body[link, leg]).name == f"{segment}_{where}"
            assert model.joint(star.ids.joint[link, leg]).name == f"{segment}_{where}"
    assert [spheres.link for spheres in star.spheres] == [None, 2]
    assert [model.geom(geom).name for geom in star.spheres[1].geoms] == [f"foot_{leg}" for leg in LEGS]
    assert star.friction == pytest.approx(0.9) and star.timestep == pytest.approx(1 / 60)


def test_legs_may_differ():
    model = crab()
    star = read(model)
    names = [[model.body(i).name if i != FILLER else "" for i in row] for row in star.ids.body]
    assert names == [["tail", "arm", "coxa"], ["", "forearm", "femur"], ["", "", "tibia"]]
    driven = [[model.actuator(i).id if i != FILLER else None for i in row] for row in star.ids.actuator]
    assert driven == [[3, 4, 2], [None, 1, None], [None, None, 0]]
    spheres = [[model.geom(i).name if i != FILLER else "" for i in spheres.geoms] for spheres in star.spheres]
    assert spheres == [["keel"], ["", "", "knee"], ["tip", "thumb", ""], ["", "finger", ""]]
    assert [spheres.link for spheres in star.spheres] == [None, 1, 2, 2]
    low, high = star.links[0].limits
    np.testing.assert_allclose(np.squeeze(low), [-NO_LIMIT, np.radians(-70), np.radians(-60)])
    np.testing.assert_allclose(np.squeeze(high), [NO_LIMIT, np.radians(60), np.radians(60)])
    assert star.limit_softness != star.softness


def test_what_legs_lack_moves_and_touches_nothing():
    star = read(crab())
    numbers = body(star, crab())
    missing = star.ids.body == FILLER
    assert not np.any(numbers.mass[missing]) and not np.any(numbers.damping[missing])
    assert (np.asarray(numbers.armature)[missing] == 1.0).all(), "or the inertia could not be inverted"
    for spheres, radius in zip(star.spheres, numbers.radius, strict=True):
        np.testing.assert_array_equal(radius == NO_SPHERE, spheres.geoms == FILLER)


@pytest.mark.parametrize("make", [load_model, quadruped, crab], ids=lambda make: make.__name__)
@pytest.mark.parametrize("which", ["body", "dof", "qpos", "joint", "actuator"])
def test_numbers_return_to_their_places(make, which):
    ids = getattr(read(make()).ids, which)
    values = jnp.asarray(np.random.default_rng(0).normal(size=(ids.max() + 1, 2)), jnp.float32)
    laid = by_link(values, ids, filler=7.0)
    assert laid.shape == (*ids.shape, 2)
    for place, own in np.ndenumerate(ids):
        np.testing.assert_array_equal(laid[place], 7.0 if own == FILLER else values[own])
    np.testing.assert_array_equal(by_id(laid, ids), values[np.sort(ids[ids != FILLER])])


def test_what_all_legs_agree_on_is_a_number():
    assert constant(np.array([0.3, 0.3])) == 0.3
    assert constant(np.array([1 + 1e-9, 1.0])) == 1.0 and constant(np.array([1e-9, -1e-9])) == 0.0
    differing = constant(np.array([0.0, 0.5]))
    assert isinstance(differing, np.ndarray) and differing.shape == (2, 1)
