"""What the star stepper cannot represent is refused by name, and what only looks so is not."""

import pytest

from srl_jax.env.model import load_model, put_model
from srl_jax.env.star.constants import read
from srl_jax.env.star.refusals import NotAStarError, check
from tests.env.star.robots import FLAG, FOOT, SERVO, crab, hopper, quadruped


def named(name: str, more: str) -> tuple[str, str]:
    """More attributes for what the hopper's description calls so."""
    return f'name="{name}"', f'name="{name}" {more}'


def before(tag: str, text: str) -> tuple[str, str]:
    """Something before what the description has."""
    return f"<{tag}", f"{text}<{tag}"


def foot(more: str) -> tuple[str, str]:
    return FOOT, FOOT.replace("/>", f" {more}/>")


def toe(more: str) -> tuple[str, str]:
    """A second sphere beside the foot."""
    return FOOT, f'{FOOT}<geom name="toe" size="0.01" pos="0.05 0 -0.12" mass="0.1" contype="1" {more}/>'


def shin(joint: str = "", geom: str = "") -> tuple[str, str]:
    """A link that hangs on the leg."""
    inside = f'<joint name="shin" axis="0 1 0" {joint}/><geom name="shin" size="0.01" mass="0.1" {geom}/>'
    return FOOT, f'{FOOT}<body name="shin">{inside}</body>'


def servo(what: str) -> tuple[str, str]:
    return SERVO, f"<{what}/>"


def section(text: str) -> tuple[str, str]:
    return "</mujoco>", f"{text}</mujoco>"


FLOOR, KEY = 'geom name="floor"', '<key name="stance" qpos="0 0 0.14 1 0 0 0 0"/>'
ROOT = "joint root carries the base and has"
FLAGS = "its flags must be the usual ones, but for eulerdamp, which must be off"
SPRING_AND_DAMPER = "a solref that is not a time constant and a damping ratio"
REFUSED = [
    # Bodies
    ("one tree of at least two bodies", before('body name="ball"', '<body><freejoint/><geom size="0.1"/></body>')),
    ("body shoe does not have exactly one joint", (FOOT, f'{FOOT}<body name="shoe"><geom size="0.01"/></body>')),
    ("body leg does not have exactly one joint", before('joint name="hinge"', '<joint name="second"/>')),
    ("body leg has two children, but legs are chains", (FOOT, FOOT + 2 * '<body><joint/><geom size="0.01"/></body>')),
    ("body leg has gravity compensation", named("leg", 'gravcomp="1"')),
    ("it has an equality", section('<equality><joint joint1="hinge"/></equality>')),
    ("it has a tendon", section('<tendon><fixed><joint joint="hinge" coef="1"/></fixed></tendon>')),
    ("it has a contact pair", section('<contact><pair geom1="floor" geom2="skin"/></contact>')),
    # Joints
    ("its base has no free joint", ('type="free"', 'type="ball"'), (KEY, "")),
    ("joint hinge is not a hinge", named("hinge", 'type="slide"')),
    ("joint hinge is not at its body's origin", named("hinge", 'pos="0 0 0.01"')),
    ("joint hinge has a margin", named("hinge", 'margin="0.1"')),
    ("joint hinge limits its actuators' force", named("hinge", 'actuatorfrcrange="-1 1"')),
    ("joint hinge has friction loss", named("hinge", 'frictionloss="0.1"')),
    ("joint hinge has damping of higher order", named("hinge", 'damping="0.1 0.1"')),
    ("joint hinge has stiffness of higher order", named("hinge", 'stiffness="0.1 0.1"')),
    (f"{ROOT} armature, damping or stiffness", named("root", 'stiffness="1"')),
    (f"{ROOT} armature, damping or stiffness", ('damping="0"', 'damping="0.1"')),
    (f"{ROOT} armature, damping or stiffness", ('armature="0"', 'armature="0.1"')),
    # Actuators
    ("it has no actuator", (SERVO, "")),
    ("actuator servo does not drive a joint", servo('position name="servo" jointinparent="hinge"')),
    ("actuator servo has dynamics", servo('position name="servo" joint="hinge" timeconst="0.1"')),
    ("actuator servo has a gain that is not fixed", servo('general name="servo" joint="hinge" gaintype="affine"')),
    ("actuator servo has a bias that is not affine", servo('general name="servo" joint="hinge" biasprm="1"')),
    ("actuator servo has a gear", servo('position name="servo" joint="hinge" gear="2"')),
    ("joint hinge has two actuators", (SERVO, f'{SERVO}<motor joint="hinge"/>')),
    (f"{ROOT} an actuator", (SERVO, f'{SERVO}<motor joint="root"/>')),
    # Options
    ("its integrator must be Euler", ('integrator="Euler"', 'integrator="implicitfast"')),
    ("its solver must be Newton", ('solver="Newton"', 'solver="CG"')),
    ("its cone must be pyramidal", ('cone="pyramidal"', 'cone="elliptic"')),
    (FLAGS, (FLAG, "")),
    (FLAGS, (FLAG, '<flag eulerdamp="disable" warmstart="disable"/>')),
    (FLAGS, (FLAG, '<flag eulerdamp="disable" invdiscrete="enable"/>')),
    ("its medium must be a vacuum", ("<option", '<option density="1.2"')),
    ("its medium must be a vacuum", ("<option", '<option viscosity="0.1"')),
    ("gravity must point along z", ("<option", '<option gravity="0 1 -9.8"')),
    # Geoms
    ("nothing of it can touch a floor", (FOOT, FOOT.replace('contype="1"', ""))),
    ("nothing of it can touch a floor", section('<contact><exclude body1="world" body2="leg"/></contact>')),
    ("geom foot may touch geom floor and is not a sphere", ('size="0.02"', 'type="ellipsoid" size="0.02 0.02 0.03"')),
    ("geom skin may touch geom shin", shin(geom='conaffinity="2"'), named("skin", 'contype="2"')),
    ("geom hill and geom floor are two floors", before(FLOOR, '<geom name="hill" size="1" conaffinity="1"/>')),
    ("geom floor is not the plane z = 0", ('type="plane" size="0 0 1"', 'type="box" size="1 1 1"')),
    ("geom floor is not the plane z = 0", named("floor", 'pos="0 0 0.1"')),
    ("geom floor is not the plane z = 0", named("floor", 'euler="0 1 0"')),
    (
        "numeric max_contact_points is less than its 2 spheres",
        toe(""),
        section('<custom><numeric name="max_contact_points" data="1"/></custom>'),
    ),
    # How contacts and limits give way
    ("geom foot or the floor has a margin or a gap", foot('margin="0.01"')),
    ("geom foot or the floor has a margin or a gap", named("floor", 'gap="0.01"')),
    ("geom foot meets the floor with a condim that is not 3", foot('condim="4"')),
    ("geom toe meets the floor with another friction than geom foot", toe('friction="1.5"')),
    ("geom toe meets the floor with another solref than geom foot", toe('solref="0.05 1"')),
    ("geom toe meets the floor with another solimp than geom foot", toe('solimp="0.8 0.9 0.01"')),
    (f"geom foot has {SPRING_AND_DAMPER}", foot('solref="-100 -10"')),
    ("geom foot has a solimp whose power is not 2", foot('solimp="0.9 0.95 0.001 0.5 3"')),
    (f"joint hinge has {SPRING_AND_DAMPER}", named("hinge", 'solreflimit="-100 -10"')),
    ("joint hinge has a solimp whose power is not 2", named("hinge", 'solimplimit="0.9 0.95 0.001 0.5 3"')),
    ("joint shin has another solref than joint hinge", shin('range="-9 9" solreflimit="0.05 1"')),
    ("joint shin has another solimp than joint hinge", shin('range="-9 9" solimplimit="0.8 0.9 0.01"')),
]

# What changes nothing of a step.
ACCEPTED = [
    (),
    ((FLAG, '<flag eulerdamp="disable" sensor="disable" island="disable" midphase="disable"/>'),),
    ((FOOT, f'{FOOT}<site name="imu"/>'), section('<sensor><gyro site="imu"/></sensor>')),
    (shin('margin="0.1" solreflimit="0.05 1"'),),  # of limits that it does not have
    (shin(geom='conaffinity="2"'), ('contype="1"/>', 'contype="3"/>')),  # parent and child
    (
        shin(geom='conaffinity="2"'),
        named("skin", 'contype="2"'),
        section('<contact><exclude body1="ball" body2="shin"/></contact>'),
    ),
    (named("floor", 'pos="3 4 0" euler="0 0 30"'),),
    (before(FLOOR, '<geom name="cellar" type="plane" size="0 0 1" pos="0 0 -1"/>'),),  # nothing can touch it
    (section('<custom><numeric name="max_contact_points" data="4"/></custom>'),),
    (toe('friction="0.5"'),),  # the floor's friction is larger
    (toe('friction="0.5" solref="0.05 1" priority="-1"'),),
]


@pytest.mark.parametrize(("sentence", "edits"), [(case[0], case[1:]) for case in REFUSED])
def test_the_part_is_named(sentence, edits):
    with pytest.raises(NotAStarError) as refused:
        check(hopper(*edits))
    said = str(refused.value).replace("'", "")
    assert said.startswith("the star stepper cannot represent this model: ") and said.endswith(".")
    assert sentence.replace("'", "") in said


@pytest.mark.parametrize("edits", ACCEPTED)
def test_what_changes_nothing_is_accepted(edits):
    check(hopper(*edits))


@pytest.mark.parametrize("make", [hopper, quadruped, crab, load_model])
def test_models_of_both_kinds_are_judged(make):
    check(make())
    check(put_model(make()))


def test_reading_a_model_of_mjx_refuses_too():
    with pytest.raises(NotAStarError, match=r"joint 'hinge' has friction loss\.$"):
        read(put_model(hopper(named("hinge", 'frictionloss="0.1"'))))
