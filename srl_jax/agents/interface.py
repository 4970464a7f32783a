"""What an algorithm is to the program that trains it: a record of pure functions of one lane, and facts about them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import jax

from srl_jax.agents.hyper import Hyper
from srl_jax.agents.settings import ActorConfig
from srl_jax.types import ActState, EndedEpisodes, Params, Transition

Teacher = Callable[[jax.Array], jax.Array]  # observation f32[O] -> action f32[A]
Metrics = dict[str, jax.Array]
State = Any  # a NamedTuple with the fields `actor` (what `student` reads) and `critic`


class Init(Protocol):
    def __call__(
        self, key: jax.Array, observation_size: int, action_size: int, *, teachers: Sequence[Teacher] = ()
    ) -> State:
        """The agent before it has learned anything."""
        ...


class Act(Protocol):
    def __call__(
        self,
        state: State,
        act_state: ActState,
        observation: jax.Array,
        key: jax.Array,
        *,
        hyper: Hyper,
        step: jax.Array,
        teachers: Sequence[Teacher] = (),
    ) -> tuple[jax.Array, ActState]:
        """The action f32[A] of training, exploration included, and what acting carries on."""
        ...


class Student(Protocol):
    def __call__(self, actor: Params, observation: jax.Array, *, teachers: Sequence[Teacher] = ()) -> jax.Array:
        """The action f32[A] of the policy that is evaluated, without noise."""
        ...


class Update(Protocol):
    def __call__(
        self,
        state: State,
        batch: Transition,
        key: jax.Array,
        *,
        hyper: Hyper,
        step: jax.Array,
        teachers: Sequence[Teacher] = (),
    ) -> tuple[State, Metrics]:
        """One step of learning from `batch_size` replayed transitions."""
        ...


class Finish(Protocol):
    def __call__(self, state: State, episodes: EndedEpisodes, *, hyper: Hyper) -> State:
        """The agent after whole episodes (leading axis E), of which only some have `ended`."""
        ...


@dataclass(frozen=True)
class Agent:
    """An algorithm with its static settings bound; `registry.agent` makes it from the settings.

    What is None an algorithm does not do: the program then neither traces nor calls it.
    """

    init: Init
    act: Act
    student: Student
    update: Update | None = None
    finish: Finish | None = None
    batch_size: int = 0  # transitions of one `update`
    metrics: tuple[str, ...] = ()  # what `update` measures; reported as means over updates
    gauge: Callable[[State], Metrics] | None = None  # running totals; reported as they stand
    reopen: Callable[[State, jax.Array], State] | None = None  # told, at a control step i32[], that the damage changed
    adopt: Callable[[State, Params], State] | None = None  # takes pi_B's actor, or its clone, as its own start
    network: ActorConfig | None = None  # of an actor that is such a network
    replays_healthy: bool = False  # parts of its mini-batches are pi_B's healthy transitions
    timed: bool = False  # it acts by the age of the episode, `ActState.age`
    own_gait: bool = False  # its only teacher is the tuned tripod, whatever pi_B is

    @property
    def replays(self) -> bool:
        """Whether transitions are stored for it."""
        return self.batch_size > 0
