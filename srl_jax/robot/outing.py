"""One outing: stand up, walk, lie down, and what is done where something is wrong."""

import contextlib
from collections.abc import Callable
from typing import Protocol

from srl_jax.env.anatomy import JOINTS, LEGS, SEGMENTS
from srl_jax.env.damage_names import HEALTHY, canonical
from srl_jax.robot.ports import BusLostError
from srl_jax.robot.safety import Poses, StoppedError


class Walk(Protocol):
    """What is done while it stands: a `Loop`, or lessons of many."""

    def run(self, seconds: float) -> object:
        """Walks for so long; errors as `Loop.run`."""
        ...


def go(
    poses: Poses, walk: Walk, seconds: float, *, torque: float = 1.0, stood: Callable[[], None] = lambda: None
) -> str:
    """Stands up, walks for so long, and lies down.

    Somebody's stop lets it lie down; what hurts the robot takes the torque off at once; where the bus has gone, servos
    hold the last pose that they were sent, which is less than half a radian from where they are.

    Args:
        poses: of the robot.
        walk: of the same robot.
        seconds: of walking.
        torque: share of a servo's torque that it may use.
        stood: is called when it stands.

    Returns:
        Why it ended before its time; empty: it did not.

    Raises:
        ValueError: as `Poses.rise`.
    """
    bus = poses.robot.bus
    try:
        poses.rise(torque)
        stood()
        if not poses.stop():
            walk.run(seconds)
        asked = poses.stop()
        poses.lie_down()
        return "it was asked to" * asked
    except StoppedError as error:
        if poses.stop():
            with contextlib.suppress(BusLostError):
                poses.lie_down()
        else:
            bus.limp()
        return str(error)
    except BusLostError as error:
        with contextlib.suppress(BusLostError):
            bus.limp()
        return f"the bus is lost: {error}"
    except BaseException:
        with contextlib.suppress(BusLostError):
            bus.limp()
        raise


def damage_of(dead: tuple[str, ...]) -> str:
    """The damage that silent joints stand for: what hangs on one that is lost is lost as well.

    Args:
        dead: names of joints.
    """
    parts = []
    for leg in LEGS:
        first = next((segment for segment in SEGMENTS if f"{segment}_{leg}" in dead), None)
        if first is not None:
            parts.append(f"{first}_{leg}")
    assert set(dead) <= set(JOINTS)
    return canonical("+".join(parts) or HEALTHY)
