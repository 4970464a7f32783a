"""A learner in a process of its own, as the walk's process has it. Imports no jax: only the learner's own does.

The walk never waits: steps go to the learner through a pipe, and a thread takes in the weights that come back.
"""

import contextlib
import multiprocessing
import os
import signal
import threading
from multiprocessing.connection import Connection
from typing import Any

from srl_jax.job.course import Course
from srl_jax.portable import Layer
from srl_jax.robot.safety import StoppedError
from srl_jax.robot.student import Episode, Step

BEHIND = 20  # steps whose updates are made up for; more are passed over
NICE = 5  # of the learner, whom the walk goes before


class Remote:
    """A learner in a process of its own; a context that lets it save and ends it."""

    def __init__(self, course: Course) -> None:
        """Starts it and waits until it is compiled.

        Raises:
            ValueError: as `learner.Learner`.
        """
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=attend, args=(theirs, course), daemon=True)
        self._process.start()
        theirs.close()
        try:
            said = self._pipe.recv()
        except EOFError:
            raise ValueError("the learner has ended before it began.") from None
        if isinstance(said, str):
            raise ValueError(said)
        self.steps: int = said[0]
        self.start: tuple[Layer, ...] = said[1]
        self._newest: tuple[Layer, ...] | None = None
        self.updates = 0  # that it has told of
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._reader.start()

    def take(self, step: Step) -> tuple[Layer, ...] | None:
        """Tells of a step; the newest weights, if any have come since. Raises StoppedError where it has gone."""
        self._tell(step)
        found, self._newest = self._newest, None
        return found

    def ended(self, episode: Episode) -> None:
        """An episode is over."""
        self._tell(episode)

    def __enter__(self) -> "Remote":
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self._pipe.send(None)
        self._process.join()
        self._pipe.close()

    def _tell(self, news: Step | Episode) -> None:
        try:
            self._pipe.send(news)
        except OSError:
            raise StoppedError("the learner has gone") from None

    def _listen(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                self.updates, self._newest = self._pipe.recv()


def attend(pipe: Connection, course: Course) -> None:
    """The learner's process: learns as fast as it can, at most as often as the course says, until the pipe ends."""
    from srl_jax.job.learner import Learner

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the walk's process ends this one, when it lies
    try:
        learner = Learner(course)
    except ValueError as error:
        pipe.send(str(error))
        return
    os.nice(NICE)
    try:
        pipe.send((learner.steps, learner.layers))
    except OSError:
        return  # nobody waits any more; somebody else may have gone on meanwhile, and nothing is to be saved
    with contextlib.suppress(EOFError, OSError):
        _attend(pipe, learner)
    learner.save()


def _attend(pipe: Connection, learner: Any) -> None:
    owed = 0
    while True:
        while pipe.poll(0.0 if owed else None):
            news = pipe.recv()
            if news is None:
                return
            if isinstance(news, Episode):
                learner.ended(news)
                continue
            learner.remember(news)
            if learner.ready:
                owed = min(owed + learner.course.updates, BEHIND * learner.course.updates)
        if owed:
            learner.improve()
            owed -= 1
            pipe.send((learner.updates, learner.layers))
