"""What hangs on the simulated servos: the hexapod in C MuJoCo, at settings that leave no error worth naming."""

from functools import partial
from typing import Any

import numpy as np

from srl_jax.env.anatomy import JOINTS
from srl_jax.env.damage_names import HEALTHY
from srl_jax.robot import imu, odometer
from srl_jax.robot.simulate.ax12 import Servo
from srl_jax.robot.table import IDS, STALL

BEHIND = 0.25  # s of simulation that a robot catches up with at once; more is passed over
IMU_PERIOD = 0.01  # s
WARM_PERIOD = 0.1  # s from one reckoning of temperature and voltage to the next
NOISE = {"gravity": 0.02, "rate": 0.05}  # standard deviations of a line, as in training


class Body:
    """A robot that lies on the floor, and its servos, as far as a moment."""

    def __init__(self, damage: str = HEALTHY, *, now: float = 0.0, seed: int = 0, noise: float = 0.0) -> None:
        """The robot, fallen from its stance without torque.

        Args:
            damage: it has from the start, a name of `damage_names`.
            now: s, the moment that it begins at.
            seed: of the inertial unit's noise.
            noise: times `NOISE`.

        Raises:
            ValueError: a bad damage name.
        """
        import mujoco

        self._mujoco = mujoco
        self.servos = {number: Servo(number, partial(self._joint, joint)) for joint, number in enumerate(IDS)}
        self._ready: dict[str, tuple[Any, np.ndarray]] = {}  # model, and which joints have their link
        self._random, self._noise = np.random.default_rng(seed), noise
        self.now = self._warmed = now
        self._goal: np.ndarray | None = None  # f64[18] rad that the motors pull to
        self.strike(damage)
        self.data = mujoco.MjData(self._model)
        self.data.qpos[:] = self._model.key("stance").qpos
        self._line, self._lines = now, b""
        self.advance(now + BEHIND)  # it falls
        self.now = self._line = self._warmed = now
        self._lines = b""

    def prepare(self, damage: str) -> None:
        """Makes ready what a damage will need, which takes longer than a control step.

        Raises:
            ValueError: a bad damage name.
        """
        from srl_jax.env import damage as damages
        from srl_jax.evaluate import converged_model

        if damage not in self._ready:
            self._ready[damage] = converged_model(damage), np.asarray(damages.present(damages.build(damage)))

    def strike(self, damage: str) -> None:
        """From now on the robot has a damage; servos of joints that it has lost are silent. Errors as `prepare`."""
        self.prepare(damage)
        self._model, present = self._ready[damage]
        self.damage = damage
        self._own = {name: getattr(self._model, name).copy() for name in _SERVO}
        for number, there in zip(IDS, present, strict=True):
            self.servos[number].alive = bool(there)
        self._drives: list[Any] = []

    def advance(self, now: float) -> None:
        """Simulates until a moment, in steps of 2 ms."""
        step = self._model.opt.timestep
        if now - self.now > BEHIND + step:
            self.now = self._line = self._warmed = now - BEHIND
        while self.now + step <= now + 1e-9:
            until = min(now, self._line + IMU_PERIOD)
            count = max(int((until - self.now) / step + 1e-6), 1)
            self._pull(count * step)
            self._mujoco.mj_step(self._model, self.data, nstep=count)
            self.now += count * step
            if self.now + 1e-9 >= self._line + IMU_PERIOD:
                self._line += IMU_PERIOD
                self._tell()
            if self.now + 1e-9 >= self._warmed + WARM_PERIOD:
                self._warm(self.now - self._warmed)
                self._warmed = self.now

    def lines(self) -> bytes:
        """What the inertial unit has said since this was last asked."""
        said, self._lines = self._lines, b""
        return said

    def placed(self) -> bytes:
        """The line of an odometer that knows where it is."""
        return odometer.line(self.data.qpos[:2], self._heading)

    def right(self) -> None:
        """Somebody puts it on its feet where it is, its front where it was; without torque it lies down."""
        place, heading = self.data.qpos[:2].copy(), self._heading
        self.data.qpos[:] = self._model.key("stance").qpos
        self.data.qpos[:2] = place
        self.data.qpos[3:7] = np.cos(heading / 2.0), 0.0, 0.0, np.sin(heading / 2.0)
        self.data.qvel[:] = 0.0

    @property
    def _heading(self) -> float:
        return float(np.arctan2(self.frame[1, 0], self.frame[0, 0]))

    @property
    def frame(self) -> np.ndarray:
        """f64[3, 3], body to world."""
        frame = np.empty(9)
        self._mujoco.mju_quat2Mat(frame, self.data.qpos[3:7])
        return frame.reshape(3, 3)

    def _pull(self, seconds: float) -> None:
        """Sets motors up as the servos' registers say."""
        drives = [self.servos[number].drive for number in IDS]
        if drives != self._drives:
            self._drives = drives
            on = np.array([drive.on for drive in drives])
            share = np.array([drive.torque for drive in drives])
            self._model.actuator_gainprm[:] = self._own["actuator_gainprm"] * on[:, None]
            self._model.actuator_biasprm[:] = self._own["actuator_biasprm"] * on[:, None]
            self._model.actuator_forcerange[:] = self._own["actuator_forcerange"] * np.maximum(share, 1e-3)[:, None]
        goal = np.array([drive.goal for drive in drives])
        reach = np.array([drive.speed for drive in drives]) * seconds
        here = self.data.qpos[7:] if self._goal is None else self._goal
        self._goal = np.clip(goal, here - reach, here + reach)
        self.data.ctrl[:] = self._goal

    def _joint(self, joint: int) -> tuple[float, float, float]:
        data = self.data
        return float(data.qpos[7 + joint]), float(data.qvel[6 + joint]), float(self._torques()[joint])

    def _torques(self) -> np.ndarray:
        """f64[18] what motors give, as shares of their stall torque: on their torque-speed line, which is damping."""
        return (self.data.actuator_force - self._model.dof_damping[6:] * self.data.qvel[6:]) / STALL

    def _warm(self, seconds: float) -> None:
        torques = np.minimum(np.abs(self._torques()), 1.0)
        everyone = float(torques.mean())
        for number, torque in zip(IDS, torques.tolist(), strict=True):
            self.servos[number].warm(torque, everyone, seconds)

    def _tell(self) -> None:
        """The inertial unit says a line."""
        noise = {name: self._noise * size * self._random.standard_normal(3) for name, size in NOISE.items()}
        self._lines += imu.line(-self.frame[2] + noise["gravity"], self.data.qvel[3:6] + noise["rate"])

    def report(self) -> dict[str, Any]:
        """Where it is and what it does, for judges."""
        return {
            "time": self.now,
            "place": [float(x) for x in self.data.qpos[:3]],
            "upright": float(self.frame[2, 2]),
            "damage": self.damage,
            "torque": sum(servo.drive.on for servo in self.servos.values()),
            "moving": float(np.abs(self.data.qvel[6:]).max()),
            "silent": [name for name, number in zip(JOINTS, IDS, strict=True) if not self.servos[number].alive],
        }


_SERVO = ("actuator_gainprm", "actuator_biasprm", "actuator_forcerange")
