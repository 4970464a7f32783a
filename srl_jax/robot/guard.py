"""Takes the torque off when the program that walks has died, however it died: ``python -m srl_jax.robot.guard PORT``.

It waits at the end of a pipe. Where the pipe ends without the word that all is well, it sends the one packet that lets
every servo go. It is a process of its own, in a session of its own, so that what kills the other does not kill it.
"""

import contextlib
import os
import subprocess
import sys
import time

import serial

from srl_jax.robot.table import BAUD

LIMP = bytes([0xFF, 0xFF, 0xFE, 4, 3, 24, 0, 0xE2])  # to all: write 0 to torque enable
WELL = b"w"
TIMES, PAUSE = 5, 0.005  # s


class Guard:
    """A watcher of this process."""

    def __init__(self, port: str) -> None:
        """Starts it and waits until it holds the port.

        Raises:
            ValueError: it cannot open the port.
        """
        command = [sys.executable, "-m", "srl_jax.robot.guard", port]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        assert self._process.stdout is not None
        if self._process.stdout.read(1) != WELL:
            raise ValueError(f"port is {port}: the guard that would take the torque off cannot open it.")

    def dismiss(self) -> None:
        """All is well: it ends without a packet."""
        self._process.communicate(WELL)


def main(port: str) -> int:
    """Waits; exit code 0 whether or not it had to act."""
    line = serial.Serial(port, BAUD, timeout=0)
    os.write(1, WELL)
    if os.read(0, 1) != WELL:
        with contextlib.suppress(OSError):  # the bus has gone: nobody can be told anything
            for _ in range(TIMES):
                line.write(LIMP)
                time.sleep(PAUSE)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
