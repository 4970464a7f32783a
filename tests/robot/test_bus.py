"""The bus: what is refused before it is sent, what is asked again, and what noise on the line does."""

import numpy as np
import pytest

from srl_jax.robot import servo
from srl_jax.robot.bus import Bus
from srl_jax.robot.ports import BusLostError
from srl_jax.robot.simulate.ax12 import Servo
from srl_jax.robot.table import IDS, REGISTERS
from tests.robot.made import made


class Noise:
    """Answers of a line, byte for byte, whatever is asked."""

    def __init__(self, wire, answers):
        self.wire, self.sent, self._waiting, self._answers = wire, [], b"", answers
        wire.writePort, wire.readPort = self.write, self.read

    def write(self, packet):
        self.sent.append(bytes(packet))
        self._waiting = self._answers(bytes(packet))
        return len(packet)

    def read(self, length):
        found, self._waiting = self._waiting[: max(length, 0)], self._waiting[max(length, 0) :]
        if not found:
            self.wire.clock.sleep_until(self.wire.clock.now() + max(self.wire.left(), 0.0) + 1e-6)
        return found


def test_registers_are_written_and_read_back():
    own = made()
    bus = own.robot.bus
    assert bus.ping(4) and bus.read(4, "return_delay") == 250
    assert bus.write(4, "return_delay", 0) and bus.read(4, "return_delay") == 0
    bus.write_all("goal_position", {number: 500 + number for number in IDS})
    assert [own.body.servos[number].get("goal_position") for number in IDS] == [500 + number for number in IDS]
    bus.limp()
    assert not any(each.drive.on for each in own.body.servos.values())


@pytest.mark.parametrize(
    ("number", "name", "value", "message"),
    [
        (0, "led", 1, "servo is 0: accepted are 1, 2, 3"),
        (254, "led", 1, "servo is 254"),
        (1, "goal", 1, "register is 'goal': those that can be written are id, "),
        (1, "present_position", 1, "register is 'present_position'"),
        (1, "torque_limit", 1024, "torque_limit of servo 1 is 1024: accepted are whole numbers from 0 to 1023"),
        (1, "torque_limit", -1, "torque_limit of servo 1 is -1"),
        (1, "torque_limit", 0.5, "torque_limit of servo 1 is 0.5"),
        (1, "torque_limit", float("nan"), "torque_limit of servo 1 is nan"),
        (1, "goal_position", 255, "goal_position of servo 1 is 255: accepted are whole numbers from 256 to 768"),
        (1, "goal_position", 769, "goal_position of servo 1 is 769"),
    ],
)
def test_what_is_out_of_limits_is_never_sent(number, name, value, message):
    own = made()
    noise = Noise(own.wire, lambda _: b"")
    with pytest.raises(ValueError, match=message):
        own.robot.bus.write(number, name, value)
    with pytest.raises(ValueError, match=message):
        own.robot.bus.write_all(name, {2: REGISTERS["led"].least, number: value} if name == "led" else {number: value})
    assert noise.sent == []


def test_noise_is_no_reading_and_no_exception():
    own = made()
    random = np.random.default_rng(0)

    def answer(packet):
        good = bytearray([255, 255, packet[2], 10, 0, *random.integers(0, 256, 8), 0])
        good[-1] = ~sum(good[2:-1]) & 0xFF
        place = random.integers(2, 14)
        good[place] ^= 1 << random.integers(8)
        noise = random.bytes(random.integers(30))
        return [noise, bytes(good), bytes(good[:place]), noise + bytes(good), b"\xff" * random.integers(40)][
            random.integers(5)
        ]

    noise, found = Noise(own.wire, answer), 0
    while len(noise.sent) < 3_000:
        found += len(own.robot.bus.round(IDS, own.clock.now() + 10.0).found)
    assert found <= 3, "one bit is always noticed; whole noise may add up once in ten thousand times"


@pytest.mark.parametrize("length", range(6))
def test_an_answer_of_another_length_is_no_reading(length):
    own = made()
    body = lambda number: bytes([number, length + 2, 0, *range(length)])  # noqa: E731
    Noise(own.wire, lambda packet: b"\xff\xff" + body(packet[2]) + bytes([~sum(body(packet[2])) & 0xFF]))
    assert own.robot.bus.round(IDS[:2], own.clock.now() + 1.0).found == {}
    assert own.robot.bus.counts.corrupt == 4


def test_a_round_ends_at_its_deadline_and_goes_on_there():
    own = made()
    first = own.robot.bus.round(IDS, own.clock.now() + 0.01)
    assert 0 < len(first.asked) < 18
    second = own.robot.bus.round(IDS, own.clock.now() + 0.01)
    assert next(iter(second.asked)) == IDS[len(first.asked)]


def test_who_is_silent_is_asked_again_and_who_is_doubted_more():
    own = made()
    own.body.servos[14].alive = own.body.servos[16].alive = False
    round = own.robot.bus.round(IDS, own.clock.now() + 1.0, doubted={16})
    assert list(round.asked)[-1] == 16 and round.asked[16] == 3 and round.asked[14] == 2 and round.asked[2] == 1
    assert set(IDS) - set(round.found) == {14, 16}


def test_an_answer_after_its_time_is_not_taken_for_the_next():
    own = made(given="late=1")
    assert own.robot.bus.read(4, "ccw_limit") == 1023 and own.robot.bus.read(4, "cw_limit") == 0


def test_a_cut_cable_says_so():
    own = made()
    own.wire.unplugged = True
    with pytest.raises(BusLostError):
        own.robot.bus.round(IDS, own.clock.now() + 1.0)


def test_ranges_are_those_of_the_joints():
    ranges = Bus(made().wire, servo.Calibration().ranges()).ranges
    assert ranges[2] == (256, 768) and ranges[4] == (171, 853) and ranges[6] == (0, 1023)


def test_a_servo_refuses_what_its_data_sheet_says():
    servo_ = Servo(1)
    goal = lambda value: servo_.execute(3, [30, value & 255, value >> 8])[0]  # noqa: E731
    assert servo_.execute(1, []) == (0, b"")
    assert servo_.execute(3, [8, 0, 2]) == (0, b"") and goal(513) == 2 and goal(512) == 0
    assert servo_.drive.on, "a goal switches the torque on"
    assert servo_.execute(3, [36, 0, 2])[0] == 8 and servo_.execute(3, [34, 255, 255])[0] == 8
    assert servo_.execute(2, [40, 20])[0] == 8 and servo_.execute(99, [])[0] == 64
    for _ in range(20_000):
        servo_.warm(1.0, 0.5, 0.1)
    assert not servo_.drive.on and servo_.execute(1, [])[0] == 4, "it has given up, for heat"
