"""Who learns while a robot walks: one lane's agent, its replay, and what of it lies in a file.

Nothing here knows the robot, or a clock: `take` is one step of learning in lock-step with the walk, `remember` and
`improve` are its halves for a process of its own (`learning`), where the walk does not wait.
"""

import dataclasses
import json
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from srl_jax import arrays, portable
from srl_jax.agents import behaviour, hyper, registry
from srl_jax.agents.settings import DDPGConfig
from srl_jax.env import task as tasks
from srl_jax.job.course import EPISODES, SAVE_EVERY, STATE, STUDENT, Course, settings
from srl_jax.portable import Layer
from srl_jax.portable.policy import layers, parameters
from srl_jax.program import replay as replays
from srl_jax.robot.student import Episode, Step
from srl_jax.types import Transition


class Learner:
    """An agent that starts from a robot's policy, which also guides it (pi_B), or from what it had learned before."""

    def __init__(self, course: Course) -> None:
        """Reads the file of a course that goes on, and compiles.

        Raises:
            ValueError: the file cannot be read, or is of another course.
        """
        self.course, (config, self._env, train) = course, settings(course)
        assert isinstance(config, DDPGConfig)
        self._agent, self._hyper = registry.agent(config), hyper.from_config(config)
        self._warmup = train.warmup
        size = course.policy.observation_size
        self._sizes = replays.Sizes(size, course.policy.action_size, 1)  # 1: every step keeps what it reached
        self._pi_b = jax.tree.map(jnp.asarray, parameters(course.policy.layers))
        self._key = jax.random.key(course.seed)
        self.steps = self.updates = 0
        self.episodes: list[Episode] = []
        state = self._agent.init(jax.random.fold_in(self._key, 0), size, course.policy.action_size)
        assert self._agent.adopt is not None and self._agent.update is not None
        self._state: Any = self._agent.adopt(state, jax.tree.map(jnp.copy, self._pi_b))
        self._replay = replays.init(train.capacity, 1, self._sizes)
        if course.resume:
            self._read(course.directory / STATE)
        self._add = jax.jit(self._added, donate_argnums=0)
        learn = jax.jit(partial(self._learned, config), donate_argnums=0)
        self._learn = learn.lower(self._state, self._replay, *self._moment()).compile()

    @property
    def layers(self) -> tuple[Layer, ...]:
        """The student's weights."""
        return layers(jax.device_get(self._state.actor))

    def take(self, step: Step) -> tuple[Layer, ...] | None:
        """Remembers a step and learns as often as the course says; the student's weights where it has learned."""
        self.remember(step)
        if not self.ready:
            return None
        for _ in range(self.course.updates):
            self.improve()
        return self.layers

    @property
    def ready(self) -> bool:
        """Whether there is enough to learn from."""
        return self.steps >= self._warmup

    def remember(self, step: Step) -> None:
        """A step goes into the replay; every few seconds of them all is saved before, the last step's updates too."""
        if self.steps and self.steps % SAVE_EVERY == 0:
            self.save()
        self._replay = self._add(self._replay, jax.tree.map(np.float32, step), jnp.int32(self.steps))
        self.steps += 1

    def improve(self) -> None:
        """One update."""
        self._state, _ = self._learn(self._state, self._replay, *self._moment())
        self.updates += 1

    def ended(self, episode: Episode) -> None:
        """An episode is over."""
        self.episodes.append(episode)

    def save(self) -> None:
        """Writes all that a course needs to go on, and the student as a policy to take home."""
        folder = self.course.directory
        folder.mkdir(parents=True, exist_ok=True)
        parts = {"agent": self._state, "replay": self._replay, "behaviour": self._pi_b}
        named = {f"{name}/{i}": x for name, tree in parts.items() for i, x in enumerate(jax.tree.leaves(tree))}
        about = {"course": self.course.about, "steps": self.steps, "updates": self.updates}
        episodes = np.array(self.episodes, float).reshape(-1, len(Episode._fields))
        arrays.save(folder / STATE, **jax.device_get(named), **{EPISODES: episodes}, about=np.array(json.dumps(about)))
        policy = self.course.policy
        said = policy.about | {"algo": self.course.algo, "method": f"{self.course.algo} on the robot"}
        portable.save(folder / STUDENT, [dataclasses.replace(policy, layers=self.layers, about=said)])

    def _read(self, path: Path) -> None:
        with arrays.reading(path, "what a robot has learned", "deploy --learn"):
            found = arrays.load(path)
            about = json.loads(str(found.pop("about")))
            self.steps, self.updates = int(about["steps"]), int(about["updates"])
            for row in found.pop(EPISODES).tolist():
                self.episodes.append(Episode(int(row[0]), row[1], row[2], bool(row[3])))
            state, replay, pi_b = (
                _filled(found, *part)
                for part in (("agent", self._state), ("replay", self._replay), ("behaviour", self._pi_b))
            )
            said = about["course"]
        same = jax.tree.all(jax.tree.map(lambda a, b: bool((a == b).all()), pi_b, self._pi_b))
        if said != self.course.about or not same:
            raise ValueError(
                f"resume is {path.parent}: it was learned with {_words(said)} and {'this' if same else 'another'} "
                f"behaviour, not with {_words(self.course.about)}; give what it was begun with."
            )
        self._state, self._replay = state, replay

    def _moment(self) -> tuple:
        """The replay's count, the lane's clock, and the key of the next update."""
        return jnp.int32(self.steps), jax.random.fold_in(self._key, self.updates + 1), self._pi_b

    def _added(self, replay: replays.Replay, step: Any, count: jax.Array) -> replays.Replay:
        fell = step.fell > 0.0  # a `Step` of arrays
        terms = tasks.reward_terms(self._env, step.progress, step.action, jnp.zeros((), bool), fell, goal_task=False)
        one = Transition(
            observation=step.observation,
            action=step.action,
            reward=jnp.sum(jnp.stack(terms)),
            discount=1.0 - fell,
            next_observation=step.next_observation,
            chosen=jnp.zeros(()),
            lot=jnp.floor(2.0**24 * jax.random.uniform(jax.random.fold_in(self._key, count))),
        )
        one = jax.tree.map(lambda x: jnp.asarray(x, jnp.float32)[None], one)
        return replays.add(replay, one, jnp.ones(1, bool), one.next_observation, count, episode_steps=1)

    def _learned(self, config: DDPGConfig, state: Any, replay: replays.Replay, count: jax.Array, key: jax.Array, pi_b):
        draw, learn = jax.random.split(key)
        batch = replays.draw(replay, count, self._agent.batch_size, draw, self._sizes)
        teacher = partial(behaviour.policy, pi_b, config=config)
        assert self._agent.update is not None
        step = count.astype(jnp.float32)
        return self._agent.update(state, batch, learn, hyper=self._hyper, step=step, teachers=(teacher,))


def _filled(found: dict[str, np.ndarray], name: str, tree: Any) -> Any:
    """A tree of the same structure with the leaves of a file."""
    leaves, structure = jax.tree.flatten(tree)
    own = [jnp.asarray(found[f"{name}/{number}"], leaf.dtype) for number, leaf in enumerate(leaves)]
    if any(new.shape != leaf.shape for new, leaf in zip(own, leaves, strict=True)):
        raise ValueError(f"{name} has another shape")
    return jax.tree.unflatten(structure, own)


def _words(about: dict[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in about.items())
