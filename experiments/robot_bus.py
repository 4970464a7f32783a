"""The robot's loop over its servos' bus, against what it must bear: jitter, bad packets, a cut cable, lost joints.

    chrt -f 10 python -m experiments.robot_bus --minutes 2

Rows `real` walk in real time over a pseudo-terminal, with the simulated robot in a process of its own; the others in
lock-step with the simulation, where nothing but the bus takes time.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import tyro

from experiments.walks.bus import Trip, over_bus
from srl_jax import pretrained
from srl_jax.atlas.robots import CRobot, World
from srl_jax.cli import deploy_story
from srl_jax.cli.deploy_options import Arguments as Deployment
from srl_jax.env.anatomy import LEGS
from srl_jax.env.damage_names import HEALTHY
from srl_jax.robot import bus, servo
from srl_jax.robot.policy import Walker
from srl_jax.robot.simulate.body import Body
from srl_jax.robot.simulate.child import Simulated
from srl_jax.robot.simulate.wire import Lockstep, Wire
from srl_jax.robot.table import REGISTERS

BAD = "drop=.02,corrupt=.01,late=.05"
SENTENCES = 100_000


@dataclass(frozen=True)
class Args:
    """Measure the loop."""

    rows: tuple[str, ...] = ("real", "stops", "faults", "mujoco", "losses", "fuzz")
    """Which."""
    minutes: float = 2.0
    """Of the walk in real time."""
    seconds: float = 10.0
    """Of each walk in lock-step."""
    starts: int = 3
    """Walks of a row in lock-step, and stops of each kind."""
    packets: int = SENTENCES
    """Malformed status packets."""
    legs: tuple[str, ...] = LEGS
    """That lose their tibia, and all."""


def walked(args: Args, damage: str = HEALTHY, *, strike: float = 0.0, given: str = "", seed: int = 0) -> Trip:
    """A walk under the atlas' policy for what the robot has at its start.

    Raises:
        ValueError: it fell, so that its metres mean nothing.
    """
    policy = pretrained.load("atlas", task="x", damage=HEALTHY if strike else damage)
    trip = over_bus(policy, args.seconds, damage, given=given, strike=strike, seed=seed)
    if trip.fell:
        raise ValueError(f"the robot fell: {damage}, seed {seed}, {given or 'clean'}.")
    return trip


def far(trip: Trip) -> float:
    """m from where it began."""
    return float(np.hypot(*trip.way))


def real(args: Args) -> None:
    """A long walk in real time."""
    print(f"A walk of {args.minutes:g} min in real time, load average {os.getloadavg()[0]:.1f}")
    with Simulated() as robot, tempfile.TemporaryDirectory() as folder:
        options = Deployment(port=robot.bus, imu=robot.imu, seconds=60 * args.minutes, log=f"{folder}/walk.jsonl")
        own = {HEALTHY: pretrained.load("atlas", task="x", damage=HEALTHY)}
        deploy_story.go(options, robot.bus, robot.imu, own, robot, lambda: False)


def stops(args: Args) -> None:
    """Seconds from what stops it until every servo is without torque, or none moves any more."""
    print("\nFrom what stops it until the torque is off, ms" + f" ({args.starts} each, reports every 2 ms)")
    for name, how in (("killed", _kill), ("operator", _interrupt), ("cable", _cut)):
        each = [_stopped(how) for _ in range(args.starts)]
        print(f"{name:<10}" + "  ".join(f"{1e3 * held:.0f} to rest, {1e3 * off:.0f} limp" for held, off in each))


def _kill(process: subprocess.Popen, robot: Simulated) -> None:
    process.kill()


def _interrupt(process: subprocess.Popen, robot: Simulated) -> None:
    process.send_signal(signal.SIGINT)
    time.sleep(0.03)
    process.send_signal(signal.SIGINT)  # the second lets it go at once


def _cut(process: subprocess.Popen, robot: Simulated) -> None:
    robot.unplug()


def _stopped(how: Callable[[subprocess.Popen, Simulated], None]) -> tuple[float, float]:
    """s until the goals do not change any more, and until no servo has torque (nan: it keeps it)."""
    with Simulated() as robot, tempfile.TemporaryDirectory() as folder:
        words = ["--port", robot.bus, "--imu", robot.imu, "--seconds", "60", "--log", f"{folder}/walk.jsonl"]
        command = [sys.executable, "-m", "srl_jax.deploy", *words]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)
        assert process.stdout is not None
        process.stdout.readline()  # it stands
        time.sleep(1.5)
        began = time.monotonic()
        how(process, robot)
        limp, still = float("nan"), float("nan")
        while time.monotonic() < began + 0.5:
            now, report = time.monotonic() - began, robot.report()
            if not report["torque"] and np.isnan(limp):
                limp = now
            if report["moving"] > 0.5:
                still = float("nan")
            elif np.isnan(still):
                still = now
            time.sleep(0.002)
        process.kill()
        process.communicate()
        return still, limp


def bad(args: Args) -> None:
    """Distance with and without bad packets."""
    print(f"\n{args.seconds:g} s in lock-step, healthy, m of {args.starts} walks")
    for given in ("", BAD):
        each = [walked(args, given=given, seed=seed) for seed in range(args.starts)]
        missed, died = sum(one.outcome.missed for one in each), sum(len(one.outcome.died) for one in each)
        metres = " ".join(f"{far(one):.2f}" for one in each)
        print(f"{given or 'clean':<34}{metres}   mean {np.mean([far(one) for one in each]):.2f}", end="")
        print(f"   readings foretold {missed}, joints taken for lost {died}")


def mujoco(args: Args) -> None:
    """Distance of the same policies without a bus."""
    print(f"\nThe same policies without a bus, {args.seconds:g} s in C MuJoCo, m")
    for damage in (HEALTHY, "leg_rm", "tibia_lf"):
        over = np.mean([far(walked(args, damage, seed=seed)) for seed in range(args.starts)])
        without = np.mean([_without(args, damage, seed) for seed in range(args.starts)])
        print(f"{damage:<10} over the bus {over:.2f}, without {without:.2f} ({over / without - 1:+.1%})")


def _without(args: Args, damage: str, seed: int) -> float:
    robot = CRobot(damage, 0, seed, World(friction=1.0, noise=0.0))
    walker, senses = Walker(pretrained.load("atlas", task="x", damage=damage)), robot.reset()
    for _ in range(round(20 * args.seconds)):
        senses = robot.step(walker.act(senses)[1])
        walker.advance()
    return float(np.hypot(*robot.positions[-1][:2]))


def losses(args: Args) -> None:
    """Seconds until servos that fall silent in mid-walk are known."""
    print("\nServos that fall silent in mid-walk: ms until the last of them is known; overruns; joints named")
    for damage in (f"{part}_{leg}" for leg in args.legs for part in ("tibia", "leg")):
        _, outcome, struck, _ = walked(args, damage, strike=args.seconds / 2)
        known = 1e3 * (max(when for when, _ in outcome.died) - struck)
        print(f"{damage:<10}{known:>6.0f}{outcome.overruns:>4}   {', '.join(joint for _, joint in outcome.died)}")


class Babbling(Wire):
    """A line on which every answer is noise, or a good packet that was cut, mended or lengthened."""

    def __init__(self, seed: int = 0) -> None:
        super().__init__(Lockstep(Body()))
        self.random, self.sent, self._noise = np.random.default_rng(seed), 0, b""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Sends bytes, which nobody hears; noise comes back."""
        self.sent += 1
        good = bytearray([0xFF, 0xFF, packet[2], 10, 0, *self.random.bytes(8), 0])
        good[-1] = ~sum(good[2:-1]) & 0xFF
        place, kind = int(self.random.integers(len(good))), int(self.random.integers(4))
        noise = self.random.bytes(int(self.random.integers(30)))
        good[place] = int(self.random.integers(256))
        self._noise = (noise, bytes(good[:place]), bytes(good), noise + bytes(good))[kind]
        return len(packet)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Noise, as long as there is some."""
        found, self._noise = self._noise[: max(length, 0)], self._noise[max(length, 0) :]
        if not found:
            self._clock._now += max(self.left(), 0.0) + 1e-6
        return found


def fuzz(args: Args) -> None:
    """Malformed packets and forbidden writes."""
    line = Babbling()
    own = bus.Bus(line, servo.Calibration().ranges())
    readings = 0
    while line.sent < args.packets:
        readings += len(own.round(servo.Calibration().ids, line.clock.now() + 10.0).found)
    print(
        f"\n{line.sent:,} malformed status packets: no exception, {readings} passed as good, as one in 256 changes none"
    )
    line.sent, refused, random = 0, 0, np.random.default_rng(1)
    names = [*REGISTERS, "nonsense"]
    for _ in range(args.packets // 10):
        number, name = int(random.integers(-2, 260)), names[random.integers(len(names))]
        register, value = REGISTERS.get(name), int(random.integers(-70_000, 70_000))
        inside = register is not None and register.writable and number in own.ranges
        least, most = own.ranges[number] if inside and name == "goal_position" else (register or REGISTERS["id"])[2:4]
        if inside and least <= value <= most:
            continue
        try:
            own.write(number, name, value)
        except ValueError:
            refused += 1
    print(f"{refused:,} writes outside the limits: {refused:,} refused, {line.sent} packets sent")


def main(args: Args) -> None:
    """Prints the rows that are asked for."""
    rows = {"real": real, "stops": stops, "faults": bad, "mujoco": mujoco, "losses": losses, "fuzz": fuzz}
    for name in args.rows:
        if name not in rows:
            raise ValueError(f"rows has {name!r}: accepted are {', '.join(rows)}.")
        rows[name](args)


if __name__ == "__main__":
    main(tyro.cli(Args))
