"""What goes on in a robot that has an atlas: it feels, doubts, chooses and acts; pure functions of one control step."""

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
from srl_jax.atlas import matrix, suspects, tracking
from srl_jax.atlas import trials as trial
from srl_jax.atlas.belief import Belief, Likelihood
from srl_jax.atlas.choice import Choice, Pace
from srl_jax.atlas.suspects import Log
from srl_jax.atlas.tracking import Gains
from srl_jax.atlas.trials import Ended, Forecast, Trials
from srl_jax.atlas.twins import Twins
from srl_jax.env import hexapod
from srl_jax.env import senses as feeling
from srl_jax.env.damage import Damage, present
from srl_jax.env.hexapod import CONTROL_HZ, EnvState
from srl_jax.env.senses import Senses
from srl_jax.env.settings import EnvConfig
from srl_jax.program import strides
from srl_jax.types import Params

HALF = np.log(0.5)
WALKS, STEPS = 2, 60  # of every policy in an imagined damage; control steps that count


@dataclass(frozen=True)
class Settings:
    """How a robot doubts, and how long it keeps a choice."""

    gains: Gains = tracking.GAINS
    pace: Pace = choices.PACE
    prior: trial.Prior = trial.PRIOR
    room: int = 64
    """Segments that it remembers."""
    poor: float = 0.5
    """Share of what was expected of a segment below which it thinks again."""


DEFAULT = Settings()


class Knowledge(NamedTuple):
    """What a robot brings along: an atlas as arrays."""

    damage: Damage  # leaves [D, ...]
    actors: Params  # leaves [I, ...]
    value: jax.Array  # f32[I, D] shares of the healthy speed
    healthy_speed: jax.Array  # f32[] m/s
    likelihood: Likelihood


class Scope(NamedTuple):
    """What of its atlas a robot may use, and how it chooses: values, so that one program serves all comparisons."""

    damages: jax.Array  # bool[D]
    policies: jax.Array  # bool[I]
    rule: jax.Array  # i32[] index into `choice.RULES`
    told: jax.Array  # i32[] the policy that somebody who knows names, in place of any rule; -1: nobody does
    blind: jax.Array  # bool[] whether it takes no notice of its senses: it is none of the damages, and trials decide
    twins: Twins  # S hypotheses more, that it has put together itself, and S policies learned for them


def widened(known: Knowledge, scope: Scope) -> tuple[Knowledge, Scope]:
    """The atlas with what a robot has added: D + S hypotheses, I + S policies, and which of them it may use.

    A policy that it has learned is trusted under the damage that it was learned for, and under no other.
    """
    own, damages = scope.twins, known.value.shape[1]
    again = jnp.arange(damages + len(own.mastery)) == own.revised
    learned = jnp.concatenate([jnp.zeros((len(own.mastery), damages)), jnp.diag(own.mastery)], axis=1)
    value = jnp.concatenate([jnp.concatenate([known.value, own.value], axis=1), learned])
    joined = partial(jax.tree.map, lambda a, b: jnp.concatenate([a, b]))
    wide = known._replace(
        damage=joined(known.damage, own.damage),
        actors=joined(known.actors, own.actors),
        value=jnp.where(again[None], own.revision[:, None], value),
    )
    policies = jnp.append(scope.policies, own.graduated)
    return wide, scope._replace(damages=jnp.append(scope.damages, own.admitted), policies=policies)


class Memory(NamedTuple):
    """What a robot carries from step to step."""

    states: EnvState  # of every hypothesis' robot, leaves [D, ...]
    belief: Belief
    choice: Choice
    trials: Trials
    forecast: Forecast  # of the running segment
    ended: Ended
    action: jax.Array  # f32[18] the last one
    phase: jax.Array  # f32[] of the gait's clock
    key: jax.Array


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
        known, scope = widened(known, scope)
        best = jnp.argmax(jnp.where(scope.policies, known.value[:, 0], -jnp.inf)).astype(jnp.int32)
        nothing = jnp.float32(jnp.nan)
        unknown = Forecast(nothing, nothing)
        return Memory(
            states=tracking.at_rest(self.robot, len(scope.damages)),
            belief=beliefs.prior(beliefs.even(scope.damages)),
            choice=Choice(best, jnp.int32(0), jnp.float32(jnp.nan)),
            trials=trial.none(self.settings.room),
            forecast=unknown,
            ended=Ended(nothing, unknown, jnp.bool_(False)),
            action=jnp.zeros(hexapod.ACTION_SIZE),
            phase=jax.random.uniform(key),
            key=key,
        )

    def think(self, known: Knowledge, scope: Scope, memory: Memory, senses: Senses) -> Memory:
        """One control step: what came of the last action, what that says of the damage, who walks, the next action."""
        known, scope = widened(known, scope)
        key, choice_key = jax.random.split(memory.key)
        states, belief = self.doubt(known, scope, memory, senses)
        choice, trials, forecast, ended = self.choose(known, scope, memory, belief, senses, choice_key)
        actor = jax.tree.map(lambda leaf: leaf[choice.policy], known.actors)
        seen = feeling.observation(senses, memory.phase, task=self.task, kind=self.observation)
        action = behaviour.policy(actor, seen, config=self.network)
        phase = jnp.mod(memory.phase + self.clock_hz / CONTROL_HZ, 1.0)
        return Memory(states, belief, choice, trials, forecast, ended, action, phase, key)

    def doubt(self, known: Knowledge, scope: Scope, memory: Memory, senses: Senses) -> tuple[EnvState, Belief]:
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
        belief = beliefs.update(memory.belief, evidence, beliefs.even(scope.damages), known.likelihood.hazard)
        blind = beliefs.strange(beliefs.even(scope.damages))
        return states, jax.tree.map(lambda own, other: jnp.where(scope.blind, other, own), belief, blind)

    def choose(
        self, known: Knowledge, scope: Scope, memory: Memory, belief: Belief, senses: Senses, key: jax.Array
    ) -> tuple[Choice, Trials, Forecast, Ended]:
        """Who walks on and what that is expected to be worth, what has been tried, and how it ended."""
        pace, prior = self.settings.pace, self.settings.prior
        choice, over, walked = choices.segment(memory.choice, jnp.asarray(senses.come), pace)
        tipping = (-senses.gravity[2] < pace.tipping) & (choice.held > pace.settle)
        over, worth = over | tipping, jnp.where(tipping, pace.toll, walked * CONTROL_HZ / known.healthy_speed)
        tried = trial.record(memory.trials, choice.policy, worth)
        trials = jax.tree.map(lambda new, old: jnp.where(jnp.isfinite(worth), new, old), tried, memory.trials)
        struck = (memory.belief.log[0] > HALF) & (belief.log[0] < HALF)  # what the healthy robot did says nothing now
        trials = trials._replace(count=jnp.where(struck, 0, trials.count))
        expected = trial.expect(belief.log, known.value, prior, learned=len(scope.twins.mastery))
        draw_key, any_key = jax.random.split(key)
        mean = trial.mean(expected, trials, prior)
        draw = trial.draw(expected, trials, draw_key, prior)
        likeliest = known.value[:, jnp.argmax(belief.log[:-1])]
        proposed = choices.proposals(mean, draw, likeliest, scope.policies, any_key)[scope.rule]
        open_minded = (belief.log[-1] < HALF) | (trials.count == 0)
        own = choices.decide(choice, over, proposed, mean, scope.policies, open_minded, pace)
        own = own._replace(policy=jnp.where(scope.told < 0, own.policy, scope.told))
        hoped = expected.mean[choice.policy]
        poor = (worth < self.settings.poor * hoped) & (hoped > pace.margin) & (belief.log[-1] < HALF)
        begun = Forecast(mean[own.policy], trial.deviation(expected, trials, own.policy, prior))
        forecast = jax.tree.map(lambda new, old: jnp.where(own.held == 0, new, old), begun, memory.forecast)
        return own, trials, forecast, Ended(worth, memory.forecast, poor)

    def imagine(self, known: Knowledge, actors: Params, damage: Damage, key: jax.Array) -> jax.Array:
        """What policies [K, ...] would be worth under a damage, f32[K]: all of them walk in its simulation."""
        starts = jax.vmap(lambda k: strides.after_strike(self.robot, damage, k))(jax.random.split(key, WALKS))
        walk = partial(matrix.walk, self.robot, self.network, STEPS)
        each = jax.vmap(jax.vmap(walk, (None, None, 0)), (0, None, None))
        speed, fell = each(actors, damage, starts)
        return jnp.mean(speed, axis=1) * (1.0 - jnp.mean(fell, axis=1)) / known.healthy_speed

    def again(self, known: Knowledge, scope: Scope, memory: Memory, senses: Senses) -> tuple[jax.Array, jax.Array]:
        """The likeliest hypothesis i32[], and what all policies would be worth under it from here, f32[I + S].

        Here: in the pose and the motion of that hypothesis' robot, in the direction that is felt.
        """
        known, _ = widened(known, scope)
        likeliest = jnp.argmax(memory.belief.log[:-1]).astype(jnp.int32)
        state, damage = (jax.tree.map(lambda leaf: leaf[likeliest], tree) for tree in (memory.states, known.damage))
        ahead = hexapod.rotation(state.qpos[3:7])[:, 0]
        towards = jnp.asarray(senses.towards)
        turn = jnp.arctan2(-towards[1], towards[0]) - jnp.arctan2(ahead[1], ahead[0])
        start = strides.turned(state, turn)._replace(phase=memory.phase)
        walk = partial(matrix.walk, self.robot, self.network, STEPS)
        speed, fell = jax.vmap(walk, (0, None, None))(known.actors, damage, start)
        return likeliest, speed * (1.0 - fell) / known.healthy_speed

    def explain(self, known: Knowledge, damage: Damage, log: Log) -> jax.Array:
        """Log-likelihood f32[C] of what was done and felt under damages, leaves [C, ...]; as `doubt` judges them."""
        there = jax.vmap(present)(damage)
        count = len(there)

        def advance(states: EnvState, row: Log) -> tuple[EnvState, jax.Array]:
            action, felt, answering = (jnp.asarray(x) for x in row)
            states, errors = tracking.follow(self.robot, damage, states, action, felt, answering, self.settings.gains)
            unexpected = jnp.sum(there != row.answering[None], axis=1)
            return states, beliefs.log_likelihood(errors, unexpected, jnp.ones(count, bool), known.likelihood)[:-1]

        each = jax.lax.scan(advance, tracking.at_rest(self.robot, count), log)[1]
        return jnp.sum(each[suspects.LEAD_IN :], axis=0)


@cache
def _robot(task: str, observation: str, clock_hz: float) -> hexapod.Hexapod:
    with jax.ensure_compile_time_eval():  # a constant of whatever program asks first
        config = EnvConfig(observation=observation)  # pyright: ignore[reportArgumentType]
        return hexapod.make(task, config, clock_hz)
