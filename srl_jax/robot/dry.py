"""A bus on which nothing is written: what would be sent is told instead. Servos are read as ever."""

from collections.abc import Callable, Mapping

from srl_jax.robot.bus import Bus
from srl_jax.robot.ports import Port


class DryBus(Bus):
    """As `Bus`, but that it says what it would write."""

    def __init__(self, port: Port, ranges: Mapping[int, tuple[int, int]], say: Callable[[str], None] = print) -> None:
        super().__init__(port, ranges)
        self._say = say

    def write(self, number: int, name: str, value: int) -> bool:
        """Says it; errors as `Bus.write`."""
        self._check(number, name, value)
        self._say(f"servo {number}: {name} = {value}")
        return True

    def write_all(self, name: str, values: Mapping[int, int]) -> None:
        """Says it; errors as `Bus.write_all`."""
        for number, value in values.items():
            self._check(number, name, value)
        self._say(f"{name}: " + " ".join(f"{number}={value}" for number, value in values.items()))

    def limp(self, times: int = 3) -> None:
        """Says it."""
        self._say("all servos: torque_enable = 0")
