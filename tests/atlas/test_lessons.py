"""When a robot learns for a damage that it has put together, and what it does with that."""

from types import SimpleNamespace

import jax
import numpy as np

from srl_jax.atlas import lessons, twins
from srl_jax.atlas.lessons import Course, School
from srl_jax.atlas.mind import widened
from srl_jax.atlas.recovery import knowledge, scope

ACTORS = {"weight": np.arange(6.0).reshape(2, 3)}
VALUE = np.array([[1.0, 0.2], [0.4, 0.6]], np.float32)
COURSE = Course(steps=(10, 20), seconds=(0.5, 1.0))


def school(worth=(0.5, 0.8)):
    asked = []

    def learn(damage, policy, steps):
        asked.append((damage, policy["weight"].tolist(), steps))
        yield {"weight": policy["weight"] + 10}
        yield {"weight": policy["weight"] + 20}

    composer = twins.Composer(
        ["healthy", "leg_rm"], lambda own: np.array([0.1, 0.3]), lambda own, log: own, [twins.nobody(VALUE, ACTORS)] * 2
    )
    for robot in (0, 1):
        composer._add(robot, "leg_rf+leg_lm", np.ones(2, bool))
    return School(learn, lambda actors, own: np.array(worth), ACTORS, COURSE), composer, asked


def attended(school, composer, robot, probabilities, usable=(True, True)):
    """Of the first twin at each step; which steps it had a learned policy after, and its weights."""
    seen = []
    for step, probability in enumerate(probabilities):
        each = np.array([probability, 0.0, 0.0])
        school.attend(composer, robot, step, each, np.array(usable))
        own = composer.twins[robot]
        seen.append((bool(own.graduated[0]), float(own.actors["weight"][0, 0]), float(own.mastery[0])))
    return seen


def test_what_is_sure_for_a_while_is_learned_for_and_given_out_stage_by_stage():
    class_, composer, asked = school()
    seen = attended(class_, composer, 0, [1.0] * 40)
    begun = lessons.LASTING - 1
    assert [graduated for graduated, *_ in seen] == [False] * (begun + 10) + [True] * (40 - begun - 10)
    assert seen[begun + 10][1:] == (13.0, 0.5) and seen[begun + 19][1] == 13.0, "from the better policy, the second"
    np.testing.assert_allclose(seen[begun + 20][1:], (23.0, 0.8), rtol=1e-6)
    assert asked == [("leg_rf+leg_lm", [3.0, 4.0, 5.0], (10, 20))]
    attended(class_, composer, 1, [1.0] * 40)
    assert len(asked) == 1, "what was learned for one serves all"


def test_learning_begins_from_a_policy_that_the_robot_may_use():
    class_, composer, asked = school()
    attended(class_, composer, 0, [1.0] * 40, usable=(True, False))
    assert asked[0][1] == [0.0, 1.0, 2.0]


def test_what_is_doubtful_is_not_learned_for():
    class_, composer, asked = school()
    wavering = ([1.0] * (lessons.LASTING - 1) + [0.5]) * 4
    assert not any(graduated for graduated, *_ in attended(class_, composer, 0, wavering))
    assert asked == []


def test_a_stage_that_is_worse_is_not_taken():
    class_, composer, _ = school(worth=(0.8, 0.5))
    seen = attended(class_, composer, 0, [1.0] * 40)
    assert seen[-1][1] == 13.0 and abs(seen[-1][2] - 0.8) < 1e-6


def test_a_learned_policy_is_trusted_under_its_own_damage_alone(atlas):
    known, own = knowledge(atlas), scope(atlas)
    made = own.twins._replace(
        mastery=np.float32([0.9, 0.0, 0.0]),
        graduated=np.array([True, False, False]),
        admitted=np.array([True, False, False]),
    )
    wide, reach = widened(known, own._replace(twins=made))
    policies, damages = known.value.shape
    assert wide.value.shape == (policies + twins.ROOM, damages + twins.ROOM)
    np.testing.assert_array_equal(wide.value[:policies, :damages], known.value)
    np.testing.assert_allclose(wide.value[policies], [0.0] * damages + [0.9, 0.0, 0.0])
    assert reach.policies.tolist() == [True] * policies + [True, False, False]
    assert reach.damages.tolist() == [True] * damages + [True, False, False]
    assert {len(leaf) for leaf in jax.tree.leaves(wide.actors)} == {policies + twins.ROOM}


def test_nothing_is_made_ready_before_the_first_lesson(atlas, monkeypatch):
    made = []

    class Apprentice:
        def __init__(self, own):
            made.append(own)

        def learn(self, damage, policy, steps):
            yield from (f"{damage} after {step}" for step in steps)

    monkeypatch.setattr(lessons, "import_module", lambda name: SimpleNamespace(Apprentice=Apprentice))
    learn = lessons.by_srl(atlas)
    assert made == []
    assert list(learn("leg_rm", {}, (10, 20))) == ["leg_rm after 10", "leg_rm after 20"]
    list(learn("leg_rf", {}, (10,)))
    assert len(made) == 1 and made[0] is atlas
