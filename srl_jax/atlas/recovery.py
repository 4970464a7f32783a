"""Robots that walk on: whatever happens to them, they find out by themselves, twenty times a second."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.atlas import choice as choices
from srl_jax.atlas import twins
from srl_jax.atlas.belief import Likelihood
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.lessons import COURSE, Course, Learn, School, by_srl
from srl_jax.atlas.mind import DEFAULT, Knowledge, Memory, Mind, Scope, Settings
from srl_jax.atlas.robots import Robot
from srl_jax.atlas.suspects import Log
from srl_jax.atlas.trials import Ended
from srl_jax.atlas.twins import Composer
from srl_jax.env import damage as damages
from srl_jax.env import damage_names
from srl_jax.env.damage import Damage
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.senses import Senses
from srl_jax.types import Params


class Story(NamedTuple):
    """What N robots thought and did in T control steps."""

    log_belief: np.ndarray  # f32[T, N, D + 1] when they chose the action of step t
    policy: np.ndarray  # i32[T, N]
    action: np.ndarray  # f32[T, N, 18]
    ended: Ended  # leaves [T, N]: the segments that ended before step t, what they were worth and were expected to be
    twins: list[list[str]]  # of every robot: the damages that it has put together; policies from I on are theirs


@partial(jax.jit, static_argnames="mind")
def _begin(known: Knowledge, scope: Scope, key: jax.Array, *, mind: Mind) -> Memory:
    return jax.vmap(partial(mind.begin, known))(scope, key)


@partial(jax.jit, static_argnames="mind", donate_argnames="memory")
def _think(known: Knowledge, scope: Scope, memory: Memory, senses: Senses, *, mind: Mind) -> Memory:
    return jax.vmap(partial(mind.think, known))(scope, memory, senses)


@partial(jax.jit, static_argnames="mind")
def _imagine(known: Knowledge, actors: Params, damage: Damage, *, mind: Mind) -> jax.Array:
    return mind.imagine(known, actors, damage, jax.random.key(0))


@partial(jax.jit, static_argnames="mind")
def _again(known: Knowledge, scope: Scope, memory: Memory, senses: Senses, number: jax.Array, *, mind: Mind):
    """Of one robot among N, leaves [N, ...]."""
    own = jax.tree.map(lambda leaf: jnp.asarray(leaf)[number], (scope, memory, senses))
    return mind.again(known, *own)


@partial(jax.jit, static_argnames="mind")
def _explain(known: Knowledge, damage: Damage, log: Log, *, mind: Mind) -> jax.Array:
    return mind.explain(known, damage, log)


def mind_of(atlas: Atlas, settings: Settings = DEFAULT) -> Mind:
    """The functions of a robot that has this atlas."""
    about = atlas.about
    return Mind(about["task"], about["observation"], about["clock_hz"], atlas.network, settings)


def knowledge(atlas: Atlas) -> Knowledge:
    """An atlas as arrays."""
    return Knowledge(
        damage=jax.tree.map(jnp.asarray, damages.stack(atlas.damages)),
        actors=jax.tree.map(jnp.asarray, atlas.actors),
        value=jnp.asarray(atlas.value),
        healthy_speed=jnp.float32(atlas.healthy_speed),
        likelihood=Likelihood(jnp.asarray(atlas.whitening)),
    )


def worth(atlas: Atlas, damage: str) -> np.ndarray:
    """What policies of an atlas are worth under any damage, f32[I]: by the matrix, else all walk in its simulation."""
    if damage in atlas.damages:
        return atlas.value[:, atlas.damages.index(damage)]
    known, own = knowledge(atlas), jax.tree.map(jnp.asarray, damages.build(damage))
    return np.asarray(_imagine(known, known.actors, own, mind=mind_of(atlas)))


def scope(
    atlas: Atlas, without: Sequence[str] = (), *, rule: str = "greedy", told: int = -1, blind: bool = False
) -> Scope:
    """All of an atlas but what concerns some damages: neither their hypotheses nor the policies trained for them.

    Args:
        atlas: see `file.load`.
        without: damages.
        rule: greedy, thompson, likeliest or uniform (`choice.propose`).
        told: the policy that somebody names who knows.
        blind: whether the robot finds out by trials alone (intelligent trial and error), not by what it feels.

    Raises:
        ValueError: an unknown rule, or a damage without meaning.
    """
    gone = {damage_names.canonical(name) for name in without}
    kept = [np.array([name not in gone for name in names]) for names in (atlas.damages, atlas.trained_for)]
    own = twins.nobody(atlas.value, atlas.actors)
    values = [*kept, np.array(choices.number(rule)), np.array(told), np.array(blind), own]
    return Scope._make(values)


def run(
    atlas: Atlas,
    robots: Sequence[Robot] | Robot,
    *,
    seconds: float,
    settings: Settings = DEFAULT,
    scopes: Callable[[int], Sequence[Scope]] | None = None,
    compose: bool = True,
    learn: Learn | bool = True,
    course: Course = COURSE,
    seed: int = 0,
    watch: Callable[[Memory, Composer], None] = lambda memory, composer: None,
) -> Story:
    """Walks robots for some seconds, side by side; whatever happens to them, each finds out by itself.

    Args:
        atlas: see `file.load`.
        robots: any that can `reset` and `step`, or one of them; nothing else of them is asked.
        seconds: of robot time.
        settings: how they doubt and choose.
        scopes: what each may use of the atlas at a control step; all of it unless told otherwise.
        compose: whether they may put damages together (`twins`).
        learn: whether policies are learned for those, by SRL in their simulation, or how.
        course: how much is learned, and the robot time that it takes.
        seed: of their draws.
        watch: is shown what they think at every control step, and what each has put together.
    """
    robots = robots if isinstance(robots, Sequence) else [robots]
    mind, known, whole = mind_of(atlas, settings), knowledge(atlas), [scope(atlas)] * len(robots)
    every = scopes or (lambda step: whole)
    keys = jax.random.split(jax.random.key(seed), len(robots))
    memory = _begin(known, _stacked(every(0)), keys, mind=mind)

    def imagine(actors: Params, damage: Damage) -> np.ndarray:
        return np.asarray(_imagine(known, actors, damage, mind=mind))

    composer = Composer(
        names=atlas.damages,
        imagine=partial(imagine, known.actors),
        explain=lambda damage, log: np.asarray(_explain(known, damage, log, mind=mind)),
        twins=[own.twins for own in every(0)],
    )
    how = by_srl(atlas) if learn is True else learn
    school = School(how, imagine, atlas.actors, course) if how else None
    senses, told = [robot.reset() for robot in robots], []
    for step in range(round(seconds * CONTROL_HZ)):
        now = every(step)
        if compose:
            _compose(composer, school, step, now, senses, told)
            now = [own._replace(twins=added) for own, added in zip(now, composer.twins, strict=True)]
        scope_rows, felt = _stacked(now), _stacked(senses)
        memory = _think(known, scope_rows, memory, felt, mind=mind)
        if compose:
            for number in {*np.flatnonzero(memory.ended.disappointing).tolist(), *composer.unsure}:
                composer.revise(number, *_again(known, scope_rows, memory, felt, number, mind=mind))
        told.append(jax.device_get((memory.belief.log, memory.choice.policy, memory.action, memory.ended)))
        watch(memory, composer)
        senses = [robot.step(action) for robot, action in zip(robots, told[-1][2], strict=True)]
    log_belief, policy, action, ended = jax.tree.map(lambda *rows: np.stack(rows), *told)
    return Story(log_belief, policy, action, ended, composer.added)


def _compose(
    composer: Composer,
    school: School | None,
    step: int,
    scopes: Sequence[Scope],
    senses: Sequence[Senses],
    told: Sequence[tuple],
) -> None:
    """What the robots add to their atlas before a control step, by what they believed at the last one."""
    for number, (own, felt) in enumerate(zip(scopes, senses, strict=True)):
        admitted = np.asarray(own.damages)
        composer.listen(number, np.asarray(felt.answering), admitted)
        if not told:
            continue
        belief, action = np.exp(told[-1][0][number]), told[-1][2][number]
        composer.doubt(number, action, felt, bool(belief[-1] > 0.5), admitted)
        if school:
            twins_of = belief[len(admitted) : -1]
            school.attend(composer, number, step, twins_of, np.asarray(own.policies))


def _stacked(rows: Sequence[NamedTuple]):
    return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)
