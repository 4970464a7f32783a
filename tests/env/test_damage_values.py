"""Damage: its names, and that its values are all that a damaged model differs in."""

import jax
import numpy as np
import pytest

from srl_jax.env import damage, damage_names
from srl_jax.env.anatomy import JOINTS, LEGS
from srl_jax.env.model import load_model, mjx, put_model
from tests.env.reference import WALKING

# Model leaves that follow the edits but enter no equation of motion here: drawing, broad phase, muscles.
NOT_PHYSICS = {
    *(".cam_poscom0", ".light_poscom0", ".geom_matid", ".geom_rgba"),
    *(".geom_aabb", ".geom_rbound", ".dof_M0", ".actuator_acc0"),
}


@pytest.fixture(scope="module")
def healthy() -> mjx.Model:
    return put_model(load_model())


# Values


@pytest.mark.parametrize("name", WALKING)
def test_a_damage_holds_every_leaf_that_matters(healthy, name):
    applied = damage.apply(healthy, damage.build(name))
    expected = put_model(damage.damaged_model(name))
    for (path, leaf), other in zip(
        jax.tree_util.tree_leaves_with_path(applied), jax.tree.leaves(expected), strict=True
    ):
        if jax.tree_util.keystr(path) not in NOT_PHYSICS:
            np.testing.assert_array_equal(leaf, other, err_msg=jax.tree_util.keystr(path))


LIMP = tuple(f"leg_{leg}:limp" for leg in ("rf", "rm", "rr", "lf", "lm", "lr"))


def test_apply_under_vmap_is_apply_one_by_one(healthy):
    batch = jax.device_get(jax.vmap(damage.apply, in_axes=(None, 0))(healthy, damage.stack(WALKING)))
    for i, name in enumerate(WALKING):
        one = jax.device_get(damage.apply(healthy, damage.build(name)))
        jax.tree.map(lambda leaf, alone, i=i: np.testing.assert_array_equal(leaf[i], alone), batch, one)


def test_the_catalogue_is_of_different_robots_with_finite_values_of_one_shape():
    names = damage_names.catalogue()
    whole = damage.stack(names)
    for field, leaf in whole._asdict().items():
        assert leaf.dtype == np.float32, field
        assert leaf.shape == (len(names), *getattr(load_model(), field).shape), field
        assert np.isfinite(leaf).all(), field
    robots = {b"".join(leaf[row].tobytes() for leaf in whole) for row in range(len(names))}
    assert len(robots) == len(names)


def test_healthy_changes_nothing():
    model = load_model()
    for field, leaf in damage.build("healthy")._asdict().items():
        np.testing.assert_array_equal(leaf, getattr(model, field).astype(np.float32), err_msg=field)


@pytest.mark.parametrize("name", damage_names.catalogue())
def test_present_are_the_joints_that_the_recompiled_robot_has_or_that_are_locked(name):
    model = damage.recompiled(name)
    has = [joint in {model.joint(i).name for i in range(model.njnt)} or f"{joint}:locked" in name for joint in JOINTS]
    np.testing.assert_array_equal(damage.present(damage.build(name)), has)


def test_stack_needs_a_name():
    with pytest.raises(ValueError, match="at least one damage"):
        damage.stack(())


# Names


def test_catalogue_counts_and_round_trips():
    names = damage_names.catalogue()
    assert len(names) == len(set(names)) == 1 + 18 * 3 + 6 + 15 == 76
    assert tuple(damage_names.canonical(name) for name in names) == names
    assert names[:4] == ("healthy", "leg_rf", "coxa_rf:limp", "coxa_rf:locked")
    assert len(damage_names.losses21()) == 21
    assert damage_names.losses21()[5:7] == ("leg_lr", "leg_rf+leg_rm")
    assert set(damage_names.losses21()) <= set(names)


@pytest.mark.parametrize(
    ("name", "canonical"),
    [
        ("healthy", "healthy"),
        ("tibia_rm:removed", "tibia_rm"),
        ("leg_lf + leg_rm:removed", "leg_rm+leg_lf"),
        ("leg_lm+tibia_rf:limp", "tibia_rf:limp+leg_lm"),
        ("tibia_rm:locked+coxa_rm:limp", "coxa_rm:limp+tibia_rm:locked"),
        ("coxa_rm", "leg_rm"),
        ("tibia_rf+coxa_rm:removed", "tibia_rf+leg_rm"),
        ("tibia_rm:limp+coxa_rm:limp+femur_rm:limp", "leg_rm:limp"),
        ("tibia_rm+coxa_rm:limp+femur_rm:limp", "coxa_rm:limp+femur_rm:limp+tibia_rm"),
        ("tibia_rm:locked+coxa_rm:locked+femur_rm:locked", "coxa_rm:locked+femur_rm:locked+tibia_rm:locked"),
        ("femur_rm+coxa_rm:locked", "coxa_rm:locked+femur_rm"),
        ("tibia_rm:locked=0", "tibia_rm:locked"),
        ("tibia_rm:locked=-20.50", "tibia_rm:locked=-20.5"),
        ("tibia_rm:weak=.5+coxa_rm:weak=0.5+femur_rm:weak=0.50", "leg_rm:weak=0.5"),
        ("tibia_rm:weak=.5+coxa_rm:weak=0.5+femur_rm:weak=0.4", "coxa_rm:weak=0.5+femur_rm:weak=0.4+tibia_rm:weak=0.5"),
        ("leg_lf:limp+tibia_rm:short=0.6", "tibia_rm:short=0.6+leg_lf:limp"),
    ],
)
def test_canonical(name, canonical):
    assert damage_names.canonical(name) == canonical == damage_names.canonical(canonical)
    for leaf, same in zip(damage.build(name), damage.build(canonical), strict=True):
        np.testing.assert_array_equal(leaf, same)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("", "unknown part ''; accepted are"),
        ("knee_rm", "unknown part 'knee_rm'; accepted are 'healthy' alone, or leg_, coxa_"),
        ("tibia_xx", "followed by one of rf, rm, rr, lf, lm, lr"),
        ("healthy+leg_rm", "unknown part 'healthy'; accepted are 'healthy' alone"),
        (
            "tibia_rm:bent",
            "unknown kind 'bent' for tibia_rm; accepted are removed, limp, locked, weak=SHARE, short=SHARE.",
        ),
        ("coxa_rm:short=0.5", "unknown kind 'short' for coxa_rm; accepted are removed, limp, locked, weak=SHARE."),
        ("tibia_rm:weak", "the part 'tibia_rm:weak'; weak takes a number from 0.05 to 0.95 behind an equals sign."),
        ("tibia_rm:weak=much", "weak takes a number from 0.05 to 0.95"),
        ("tibia_rm:short=1", "short takes a number from 0.3 to 0.95"),
        ("tibia_rm:locked=46", "locked takes a number from -45 to 45"),
        ("tibia_rm:locked=", "locked takes a number from -45 to 45"),
        ("tibia_rm:limp=0.5", "limp takes no number behind an equals sign."),
        ("tibia_rm:locked=nan", "locked takes a number"),
        ("tibia_rm:", "unknown kind '' for tibia_rm"),
        ("leg_rm:locked", "unknown kind 'locked' for leg_rm; accepted are removed, limp"),
        ("leg_rm+leg_rm", "names coxa_rm twice, by 'leg_rm' and 'leg_rm'"),
        ("leg_rm+tibia_rm:limp", "names tibia_rm twice, by 'leg_rm' and 'tibia_rm:limp'"),
        ("tibia_rm:locked+femur_rm", "names tibia_rm twice, by 'tibia_rm:locked' and 'femur_rm'"),
        ("leg_rm+coxa_rm", "names coxa_rm twice, by 'leg_rm' and 'coxa_rm'"),
        ("tibia_rm:limp+tibia_rm", "names tibia_rm twice"),
    ],
)
def test_bad_names_are_refused_in_a_sentence(name, sentence):
    for function in (damage_names.canonical, damage.build, damage.recompiled):
        with pytest.raises(ValueError, match=r"^damage .*\.$") as error:
            function(name)
        assert sentence in str(error.value)


def test_sets_and_lists_for_the_command_line():
    assert damage_names.task_set("x") == tuple(f"tibia_{leg}" for leg in LEGS)
    assert damage_names.task_set("xy") == damage_names.task_set("p2p") == tuple(f"leg_{leg}" for leg in LEGS)
    assert damage_names.parse_names("task", "x") == damage_names.task_set("x")
    assert damage_names.parse_names("all", "x") == damage_names.catalogue()
    assert damage_names.parse_names("healthy, leg_lf+leg_rm", "x") == ("healthy", "leg_rm+leg_lf")
    with pytest.raises(ValueError, match="'leg_rm' more than once"):
        damage_names.parse_names("leg_rm,leg_rm:removed", "x")
    with pytest.raises(ValueError, match="'leg_rm' more than once"):
        damage_names.parse_names("leg_rm,coxa_rm", "x")
    with pytest.raises(ValueError, match="task is 'walk'; accepted are x, xy, p2p"):
        damage_names.parse_names("task", "walk")


def test_sets_may_be_joined_and_share_members():
    assert damage_names.parse_names("losses21+limp", "x") == (*damage_names.losses21(), *LIMP)
    assert damage_names.parse_names("healthy, limp", "x") == ("healthy", *LIMP)
    assert damage_names.parse_names("limp+healthy", "x") == (*LIMP, "healthy")
    assert damage_names.parse_names("all+triples", "x")[-20:] == damage_names.lost(3)
    assert len(damage_names.parse_names("all,leg_rm+leg_lf", "x")) == 76
    with pytest.raises(ValueError, match="unknown part 'losses21'"):
        damage_names.parse_names("losses21+leg_rm", "x")
