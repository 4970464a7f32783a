"""Robots that walk on: they feel, doubt, choose and act, twenty times a second, and know nothing else."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax.agents import behaviour
from srl_jax.agents.settings import DDPGConfig
from srl_jax.atlas import belief as beliefs
from srl_jax.atlas import choice as choices
from srl_jax.atlas import senses as feeling
from srl_jax.atlas import tracking
from srl_jax.atlas.belief import Belief, Likelihood
from srl_jax.atlas.choice import Choice
from srl_jax.atlas.file import Atlas
from srl_jax.atlas.robots import Robot
from srl_jax.atlas.senses import Senses
from srl_jax.atlas.tracking import Gains
from srl_jax.env import damage as damages
from srl_jax.env import damage_names, hexapod
from srl_jax.env.damage import Damage, present
from srl_jax.env.hexapod import CONTROL_HZ
from srl_jax.env.settings import EnvConfig
from srl_jax.env.star.stepper import State
from srl_jax.types import Params


@dataclass(frozen=True)
class Settings:
    """How a robot doubts, and how long it keeps a choice."""

    hold: int = 20
    """Control steps that a choice is kept unless another is better by the margin: a second."""
    margin: float = 0.1
    """Share of the healthy speed by which another must be better to take over at once."""
    gains: Gains = tracking.GAINS


DEFAULT = Settings()


class Knowledge(NamedTuple):
    """What a robot brings along: an atlas as arrays."""

    damage: Damage  # leaves [D, ...]
    actors: Params  # leaves [I, ...]
    value: jax.Array  # f32[I, D] shares of the healthy speed
    likelihood: Likelihood


class Scope(NamedTuple):
    """What of its atlas a robot may use, and how it chooses: values, so that one program serves all comparisons."""

    damages: jax.Array  # bool[D]
    policies: jax.Array  # bool[I]
    rule: jax.Array  # i32[] index into `choice.RULES`
    told: jax.Array  # i32[] the policy that somebody who knows names, in place of any rule; -1: nobody does


class Memory(NamedTuple):
    """What a robot carries from step to step."""

    states: State  # of every hypothesis' robot, leaves [D, ...]
    belief: Belief
    choice: Choice
    action: jax.Array  # f32[18] the last one
    phase: jax.Array  # f32[] of the gait's clock
    key: jax.Array


class Story(NamedTuple):
    """What N robots thought and did in T control steps."""

    log_belief: np.ndarray  # f32[T, N, D + 1] when they chose the action of step t
    policy: np.ndarray  # i32[T, N]
    action: np.ndarray  # f32[T, N, 18]


@dataclass(frozen=True)
class Mind:
    """The functions of a robot that has an atlas; equal ones share what jax has compiled."""

    task: str
    observation: str
    clock_hz: float
    network: DDPGConfig
    settings: Settings

    @property
    def robot(self) -> hexapod.Hexapod:
        """Whose physics the hypotheses have."""
        return _robot(self.task, self.observation, self.clock_hz)

    def begin(self, known: Knowledge, scope: Scope, key: jax.Array) -> Memory:
        """Before the first step: healthy, and walking as the healthy do."""
        return Memory(
            states=tracking.at_rest(self.robot, len(known.damage.body_mass)),
            belief=beliefs.prior(beliefs.even(scope.damages)),
            choice=Choice(jnp.argmax(known.value[:, 0]).astype(jnp.int32), jnp.int32(self.settings.hold)),
            action=jnp.zeros(hexapod.ACTION_SIZE),
            phase=jax.random.uniform(key),
            key=key,
        )

    def think(self, known: Knowledge, scope: Scope, memory: Memory, senses: Senses) -> Memory:
        """One control step: what came of the last action, what that says of the damage, who walks, the next action."""
        key, choice_key = jax.random.split(memory.key)
        states, belief = self.doubt(known, scope, memory, senses)
        choice = self.choose(known, scope, memory.choice, belief, choice_key)
        actor = jax.tree.map(lambda leaf: leaf[choice.policy], known.actors)
        seen = feeling.observation(senses, memory.phase, task=self.task, kind=self.observation)
        action = behaviour.policy(actor, seen, config=self.network)
        phase = jnp.mod(memory.phase + self.clock_hz / CONTROL_HZ, 1.0)
        return Memory(states, belief, choice, action, phase, key)

    def doubt(self, known: Knowledge, scope: Scope, memory: Memory, senses: Senses) -> tuple[State, Belief]:
        """The hypotheses' robots after the last action, and the belief that they leave."""
        states, errors = tracking.follow(
            self.robot,
            known.damage,
            memory.states,
            memory.action,
            feeling.felt(senses),
            jnp.asarray(senses.answering),
            self.settings.gains,
        )
        unexpected = jnp.sum(jax.vmap(present)(known.damage) != senses.answering[None], axis=1)
        evidence = beliefs.log_likelihood(errors, unexpected, scope.damages, known.likelihood)
        return states, beliefs.update(memory.belief, evidence, beliefs.even(scope.damages), known.likelihood.hazard)

    def choose(self, known: Knowledge, scope: Scope, choice: Choice, belief: Belief, key: jax.Array) -> Choice:
        """Who walks on."""
        proposed = choices.propose(belief.log, known.value, scope.policies, key, scope.rule)
        expected = choices.values(belief.log, known.value)
        own = choices.commit(choice, proposed, expected, hold=self.settings.hold, margin=self.settings.margin)
        return own._replace(policy=jnp.where(scope.told < 0, own.policy, scope.told))


@cache
def _robot(task: str, observation: str, clock_hz: float) -> hexapod.Hexapod:
    with jax.ensure_compile_time_eval():  # a constant of whatever program asks first
        config = EnvConfig(observation=observation)  # pyright: ignore[reportArgumentType]
        return hexapod.make(task, config, clock_hz)


@partial(jax.jit, static_argnames="mind")
def _begin(known: Knowledge, scope: Scope, key: jax.Array, *, mind: Mind) -> Memory:
    return jax.vmap(partial(mind.begin, known))(scope, key)


@partial(jax.jit, static_argnames="mind", donate_argnames="memory")
def _think(known: Knowledge, scope: Scope, memory: Memory, senses: Senses, *, mind: Mind) -> Memory:
    return jax.vmap(partial(mind.think, known))(scope, memory, senses)


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
        likelihood=Likelihood(jnp.asarray(atlas.whitening)),
    )


def scope(atlas: Atlas, without: Sequence[str] = (), *, rule: str = "greedy", told: int = -1) -> Scope:
    """All of an atlas but what concerns some damages: neither their hypotheses nor the policies trained for them.

    Args:
        atlas: see `file.load`.
        without: damages.
        rule: greedy, thompson, likeliest or uniform (`choice.propose`).
        told: the policy that somebody names who knows.

    Raises:
        ValueError: an unknown rule, or a damage without meaning.
    """
    gone = {damage_names.canonical(name) for name in without}
    kept = [np.array([name not in gone for name in names]) for names in (atlas.damages, atlas.trained_for)]
    return Scope(kept[0], kept[1], np.array(choices.number(rule)), np.array(told))  # pyright: ignore[reportArgumentType]


def run(
    atlas: Atlas,
    robots: Sequence[Robot],
    *,
    seconds: float,
    settings: Settings = DEFAULT,
    scopes: Callable[[int], Sequence[Scope]] | None = None,
    seed: int = 0,
    watch: Callable[[Memory], None] = lambda memory: None,
) -> Story:
    """Walks robots for some seconds, side by side; whatever happens to them, each finds out by itself.

    Args:
        atlas: see `file.load`.
        robots: any that can `reset` and `step`; nothing else of them is asked.
        seconds: of robot time.
        settings: how they doubt and choose.
        scopes: what each may use of the atlas at a control step; all of it unless told otherwise.
        seed: of their draws.
        watch: is shown what they think at every control step.
    """
    mind, known, whole = mind_of(atlas, settings), knowledge(atlas), [scope(atlas)] * len(robots)
    every = scopes or (lambda step: whole)
    keys = jax.random.split(jax.random.key(seed), len(robots))
    memory = _begin(known, _stacked(every(0)), keys, mind=mind)
    senses, told = [robot.reset() for robot in robots], []
    for step in range(round(seconds * CONTROL_HZ)):
        memory = _think(known, _stacked(every(step)), memory, _stacked(senses), mind=mind)
        told.append(jax.device_get((memory.belief.log, memory.choice.policy, memory.action)))
        watch(memory)
        senses = [robot.step(action) for robot, action in zip(robots, told[-1][2], strict=True)]
    return Story(*(np.stack(part) for part in zip(*told, strict=True)))


def _stacked(rows: Sequence[NamedTuple]):
    return jax.tree.map(lambda *leaves: np.stack(leaves), *rows)
