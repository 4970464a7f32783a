"""A simulated robot in a process of its own, for programs that want one to talk to."""

import json
import subprocess
import sys
from typing import Any


class Simulated:
    """A running ``python -m srl_jax.robot.simulate``; a context that ends it."""

    def __init__(self, *words: str) -> None:
        """Starts it and waits until it answers.

        Args:
            words: of its command line.

        Raises:
            ValueError: it has refused them.
        """
        command = [sys.executable, "-m", "srl_jax.robot.simulate", "--orders", *words]
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        # In a session of its own, so that Ctrl-C reaches the program and not its robot.
        self._process = subprocess.Popen(command, text=True, start_new_session=True, **pipes)
        try:
            names = self._said()
        except ValueError:
            said = self._process.communicate()[1].strip()
            raise ValueError(f"the simulation has ended: {said.removeprefix('srl_jax: ')}") from None
        self.bus, self.imu, self.odometer = (names[name] for name in ("bus", "imu", "odometer"))

    def strike(self) -> None:
        """Its damage strikes."""
        self._tell("strike")

    def unplug(self) -> None:
        """The bus hangs up."""
        self._tell("unplug")

    def right(self) -> None:
        """Somebody puts it on its feet."""
        self._tell("right")

    def report(self) -> dict[str, Any]:
        """Where it is and what it does, see `Body.report`."""
        self._tell("report")
        return self._said()

    def __enter__(self) -> "Simulated":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def _tell(self, order: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(order + "\n")
        self._process.stdin.flush()

    def _said(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())
