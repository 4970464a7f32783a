"""Learning for damages that a robot has put together: in their simulation, while it walks on by what it knows."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib import import_module

import jax
import numpy as np

from srl_jax.atlas import twins
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.twins import Composer
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.types import Params

SURE = 0.9  # probability of a damage from which on it is worth learning for
LASTING = 10  # control steps for which it must have been that probable

Learn = Callable[[str, Params, tuple[int, ...]], Iterator[Params]]  # damage, policy to start from, stages -> actors


APPRENTICE = "srl_jax.job.apprentice"  # imported when something is first to be learned: it trains


def by_srl(atlas: Atlas) -> Learn:
    """SRL in the twin; nothing is imported or compiled before the first lesson."""
    made: list[Learn] = []

    def learn(damage: str, policy: Params, steps: tuple[int, ...]) -> Iterator[Params]:
        if not made:
            made.append(import_module(APPRENTICE).Apprentice(atlas).learn)
        return made[0](damage, policy, steps)

    return learn


@dataclass(frozen=True)
class Course:
    """What is learned, and how much robot time goes by meanwhile: the computing time that is granted to it."""

    steps: tuple[int, ...] = (10_000, 20_000)
    """Environment steps of simulated training after which a policy is given out."""
    seconds: tuple[float, ...] = (5.0, 10.0)
    """After the beginning, when each of them is ready."""


COURSE = Course()


@dataclass
class School:
    """Has policies learned for the twins of N robots; what was learned for one serves all that begin the same."""

    learn: Learn
    judge: Callable[[Params, Damage], np.ndarray]  # actors [K, ...], a damage -> what they are worth, f32[K]
    actors: Params  # of the atlas, leaves [I, ...]
    course: Course = COURSE
    taught: dict[tuple[str, int], list[tuple[Params, float]]] = field(default_factory=dict)
    _sure: dict[tuple[int, int], int] = field(default_factory=dict)  # robot, slot: control steps
    _begun: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)  # the step, the teacher

    def attend(self, composer: Composer, robot: int, step: int, probability: np.ndarray, usable: np.ndarray) -> None:
        """One control step of a robot.

        Args:
            composer: whose twins are learned for.
            robot: its number.
            step: of control.
            probability: f32[S] of its twins.
            usable: bool[I] policies of the atlas that it may walk by.
        """
        for slot in range(len(composer.added[robot])):
            place = (robot, slot)
            sure = probability[slot] > SURE
            self._sure[place] = self._sure.get(place, 0) + 1 if sure else 0
            if place not in self._begun and self._sure[place] >= LASTING:
                value = np.where(usable, composer.twins[robot].value[:, slot], -np.inf)
                self._begun[place] = step, int(np.argmax(value))
            if place in self._begun:
                self._give_out(composer, robot, slot, step)

    def _give_out(self, composer: Composer, robot: int, slot: int, step: int) -> None:
        begun, teacher = self._begun[robot, slot]
        due = [round(seconds * CONTROL_HZ) for seconds in self.course.seconds]
        if step - begun not in due:
            return
        name, own = composer.added[robot][slot], composer.twins[robot]
        stages = self.lesson(name, teacher, composer.made[name][0])
        actor, worth = stages[due.index(step - begun)]
        if worth <= own.mastery[slot]:  # what was learned since has not helped
            return
        composer.twins[robot] = own._replace(
            actors=jax.tree.map(lambda old, new: twins.put(old, slot, new), own.actors, actor),
            mastery=twins.put(own.mastery, slot, worth),
            graduated=twins.put(own.graduated, slot, True),
        )
        composer.unsure.add(robot)

    def lesson(self, name: str, teacher: int, damage: Damage) -> list[tuple[Params, float]]:
        """The policy after every stage of a course, and what it is worth in the simulation that it was learned in."""
        if (name, teacher) not in self.taught:
            policy = jax.tree.map(lambda leaf: leaf[teacher], self.actors)
            stages = list(self.learn(name, policy, self.course.steps))
            worth = np.asarray(self.judge(jax.tree.map(lambda *leaves: np.stack(leaves), *stages), damage))
            self.taught[name, teacher] = list(zip(stages, worth.tolist(), strict=True))
        return self.taught[name, teacher]
