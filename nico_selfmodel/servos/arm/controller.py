"""An arm by the names of its joints, in radians, through its self-model."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from nico_selfmodel.errors import BusError, RobotError, ServoFault
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.names import refuse_unknown
from nico_selfmodel.servos.arm.axis import Axis, state_of
from nico_selfmodel.servos.arm.motion_plan import aim_together
from nico_selfmodel.servos.arm.motor import JointBus
from nico_selfmodel.servos.arm.pose_limits import PoseLimits
from nico_selfmodel.servos.arm.readiness import require_ready, require_zero
from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.arm.shutdown import (
    release_at_once,
    release_each,
    stop_each,
    without_faults,
)
from nico_selfmodel.servos.arm.take_over import switch_on, take_over
from nico_selfmodel.servos.arm_state import ArmState
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.drivers import driver_of
from nico_selfmodel.servos.ports import PortLostError
from nico_selfmodel.with_blocks import ClosedAtEnd

_T = TypeVar("_T")

_STALE = 0.1


class ArmController(ClosedAtEnd):
    """Drives the joints of a configuration. Making one sends nothing, connecting moves nothing.

    Nothing here waits for a motion: `move` and `command` set goals, and each `cycle` reads every
    joint and moves the goals of the motors on. Without cycles, or without a `heartbeat` in time,
    the arm stops within the heartbeat and half a second, whatever became of this process.
    Not for several threads at once: see `ArmLoop`.
    """

    def __init__(
        self,
        bus: JointBus,
        config: ServoConfig,
        servos: ServoMap | None = None,
        *,
        trust_zero: bool = False,
    ) -> None:
        """Describe an arm.

        Args:
            bus: Its motors, of any make, on their open port.
            servos: Of its self-model; gears of 1 and zeros of 0 if omitted.
            trust_zero: Accept poses though a zero was not set since power-up.

        Raises:
            ValueError: If the self-model is about other joints or encoders.
        """
        self.bus, self.config, self.trust_zero = bus, config, trust_zero
        self.servos = config.servo_map(servos)
        self.limits = PoseLimits(config, self.servos)
        self.axes = [
            Axis(joint, motor, bus.port, config.heartbeat)
            for joint, motor in zip(config.joints, bus.motors, strict=True)
        ]
        self._connected = False
        self._alive = -math.inf
        self._silent = False

    @classmethod
    def open(
        cls,
        port: str,
        config: ServoConfig,
        servos: ServoMap | None = None,
        *,
        trust_zero: bool = False,
        settings: BusSettings | None = None,
    ) -> "ArmController":
        """Open the port of an arm; sends nothing.

        Args:
            port: `/dev/serial/by-id/...`, or of a `SimulatedBus`.
            config: Its joints, and the make of their motors.
            servos: Of its self-model; gears of 1 and zeros of 0 if omitted.
            trust_zero: Accept poses though a zero was not set since power-up.
            settings: How patient the bus is; the configuration's latency if omitted.

        Raises:
            PortLostError: If the port cannot be opened.
            BusError: If the package that speaks to this make is missing.
            ValueError: If the self-model is about other joints or encoders.
        """
        config.servo_map(servos)  # before the port is touched
        settings = settings or BusSettings(latency=config.latency)
        bus = driver_of(config.make).open(port, config, settings)
        return cls(bus, config, servos, trust_zero=trust_zero)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names in order."""
        return self.config.joint_names

    @property
    def name(self) -> str:
        """What the arm is called."""
        return self.config.name

    @property
    def longest_silence(self) -> float:
        """Time between two heartbeats after which the arm stops [s]."""
        return self.config.heartbeat

    def now(self) -> float:
        """Return the time of the port, which states are stamped with [s]."""
        return self.bus.port.now()

    def axis(self, joint: str) -> Axis:
        """Return the axis of a joint.

        Raises:
            ValueError: If there is none of this name.
        """
        return self._chosen([joint])[0]

    @property
    def rezero_due(self) -> tuple[str, ...]:
        """Joints whose zero was not set since their motor was powered up."""
        return tuple(axis.joint.name for axis in self.axes if not axis.zero_known)

    @property
    def moving(self) -> bool:
        """Whether a joint is on its way."""
        return any(axis.on_its_way for axis in self.axes)

    def connect(self) -> tuple[str, ...]:
        """Find the motors and read them all. Moves nothing, and resets nothing that has a zero.

        A motor whose servo is on (an earlier program left it holding) stays on, with the gains of
        the configuration; one that still moves is stopped before anything else.

        Returns:
            `rezero_due`: the joints whose zero is not known.

        Raises:
            BusError: If a motor is missing, or is not what it should be.
        """
        self._connected = False
        self.bus.find()
        for axis in self.axes:  # all brake before the first is waited for
            axis.motor.halt()
        for axis in self.axes:
            take_over(axis)
        self._connected = True
        self.heartbeat()
        return self.rezero_due

    def enable(self, joints: Sequence[str] | None = None) -> None:
        """Switch servos on where the joints stand. Nothing moves.

        Args:
            joints: Names; all if omitted.

        Raises:
            RobotError: If one cannot be switched on; those that were are switched off again.
        """
        self._require_connection()
        done: list[Axis] = []
        try:
            for axis in self._chosen(joints):
                if axis.lost:
                    take_over(axis)  # switching on would let go of what it may still hold
                if not axis.enabled:
                    done.append(axis)
                    switch_on(axis)
        except RobotError:
            release_each(done)
            raise
        self.heartbeat()

    def move(
        self,
        targets: Mapping[str, float],
        *,
        speed: float | None = None,
        acceleration: float | None = None,
    ) -> float:
        """Send joints to displacements, so that they start and arrive together.

        Args:
            targets: Joint -> displacement [rad]; joints that are not named stay.
            speed: Largest joint speed [rad/s]; the limits if omitted.
            acceleration: [rad/s^2]; the limits if omitted.

        Returns:
            How long it will take [s].

        Raises:
            ValueError: If a target, the speed or the acceleration is not finite or beyond a limit.
            ServoFault: If a zero is not known, or a joint is not enabled.
            BusError: If a motor does not answer.
        """
        goals = self.check_targets(targets)
        axes = self._chosen(list(targets))
        chosen = [self.axes.index(axis) for axis in axes]
        v = self.limits.motor_speed(speed)[chosen]
        a = self.limits.motor_braking(speed, acceleration)[chosen]
        self._require_connection()
        require_ready(axes, trusted=self.trust_zero)
        self._read_anew()
        seconds = aim_together(axes, goals, v.tolist(), a.tolist())
        self.heartbeat()
        self._guard([axis for axis in self.axes if axis.enabled], lambda axis: axis.load())
        self._on_port(self.bus.flush)
        return seconds

    def _read_anew(self) -> None:
        """Read the joints where the last reading is too old to plan a motion from."""
        now = self.now()
        self._guard(
            [axis for axis in self.axes if axis.enabled and now - axis.seen > _STALE],
            lambda axis: axis.refresh(alive=False),
        )

    def check_targets(self, targets: Mapping[str, float]) -> list[int]:
        """Return the motors' counts at displacements, in the order of the joints; sends nothing.

        Args:
            targets: Joint -> displacement [rad].

        Raises:
            ValueError: If a joint does not exist, or a target is not finite or beyond a limit.
        """
        chosen = [self.axes.index(axis) for axis in self._chosen(list(targets))]
        q = np.full(len(self.axes), np.nan)
        for name, value in targets.items():
            q[self.joints.index(name)] = value
        return self.limits.registers(q, chosen)

    def check_zero(self, joints: Sequence[str]) -> None:
        """Refuse joints that do not know where they are; sends nothing.

        Raises:
            ValueError: If a joint does not exist.
            ServoFault: If a zero is not known, or a reading cannot be true.
        """
        require_zero(self._chosen(joints), trusted=self.trust_zero)

    def command(
        self, q: ArrayLike, *, speed: float | None = None, joints: Sequence[int] | None = None
    ) -> None:
        """Set where joints are to go; sends nothing, the next `cycle` does. For streams.

        Args:
            q: Joint displacements [rad]. Shape (n,).
            speed: Largest joint speed [rad/s]; the limits if omitted.
            joints: Which of them are meant, the others stay as they are; all if omitted.

        Raises:
            ValueError: If it is not finite or beyond a limit.
            ServoFault: If a zero is not known, or a joint is not enabled.
        """
        q = np.asarray(q, dtype=float)
        if q.shape != (len(self.axes),):
            raise ValueError(f"q must have shape ({len(self.axes)},), got {q.shape}")
        chosen = range(len(q)) if joints is None else joints
        goals = self.limits.registers(q, chosen)
        speeds, accelerations = self.limits.motor_speed(speed), self.limits.motor_braking(None)
        self._require_connection()
        require_ready([self.axes[k] for k in chosen], trusted=self.trust_zero)
        for k, goal in zip(chosen, goals, strict=True):
            self.axes[k].aim(goal, float(speeds[k]), float(accelerations[k]))
        self.heartbeat()

    def heartbeat(self) -> None:
        """Say that the host is alive; without it the arm stops after the heartbeat time."""
        self._alive = self.now()
        self._silent = False

    def cycle(self) -> ArmState:
        """Read every joint once and move the goals on.

        Raises:
            BusError: If a motor is lost; it is named, and the others were stopped.
            ServoFault: If a motor reports a fault; the others were stopped.
        """
        self._require_connection()
        if self.now() - self._alive > self.config.heartbeat and not self._silent:
            self._silent = True
            if self.moving:
                self.stop()
        self._on_port(self.bus.read_all)
        self._guard(self.axes, lambda axis: axis.refresh(alive=not self._silent))
        self._on_port(self.bus.flush)
        return self.state()

    def _guard(self, axes: Sequence[Axis], action: Callable[[Axis], None]) -> None:
        """Do something with each axis; where one fails, stop all others and name it."""
        for axis in axes:
            try:
                action(axis)
            except PortLostError as error:
                raise self._port_lost(error) from error
            except RobotError as error:
                axis.lost = str(error)
                axis.forget_goal()
                kind = ServoFault if isinstance(error, ServoFault) else BusError
                if kind is ServoFault:
                    # Until somebody enables it again; stopping the group would switch it on.
                    release_each([axis])
                others = self._stop_others(axis, look=kind is ServoFault)
                what = str(error) if str(axis) in str(error) else f"{axis} is lost: {error}"
                raise kind(f"{what}. {others}", partial=self.state()) from error

    def _on_port(self, action: Callable[[], _T]) -> _T:
        """Do something with all motors at once."""
        try:
            return action()
        except PortLostError as error:
            raise self._port_lost(error) from error

    def _port_lost(self, error: PortLostError) -> PortLostError:
        self._connected = False
        return PortLostError(
            f"{error}. The arm stops by itself: no goal lies further ahead than "
            f"{self.config.heartbeat:g} s"
        )

    def _stop_others(self, failed: Axis, *, look: bool) -> str:
        """Stop every axis but one, after a look at each; return what came of it."""
        others = [axis for axis in self.axes if axis is not failed and axis.enabled]
        failures = stop_each(self.bus, without_faults(others) if look else others)
        off = [axis.joint.name for axis in others if not axis.enabled]
        words = [f"Switched off too, by faults of their own: {', '.join(off)}"] if off else []
        faults = [axis.lost for axis in others if not axis.enabled]
        failures = [failure for failure in failures if failure not in faults]
        if failures:
            words.append(f"Not stopped either: {'; '.join(failures)}")
        elif len(off) < len(others):
            words.append("The other joints were stopped and hold")
        return ". ".join(words or ["No other joint is enabled"])

    def stop(self, *, smoothly: bool = True) -> None:
        """Stop every joint that is enabled and hold; the arm does not fall.

        Raises:
            BusError: If a motor did not confirm; all others were told nevertheless.
            PortLostError: If the port is gone.
        """
        self._require_connection()
        axes = [axis for axis in self.axes if axis.enabled]
        failures = self._on_port(lambda: stop_each(self.bus, axes, smoothly=smoothly))
        if failures:
            raise BusError(f"not every joint confirmed the stop: {'; '.join(failures)}")

    def release(self, joints: Sequence[str] | None = None) -> None:
        """Switch motors off: what gravity pulls falls.

        Args:
            joints: Names; all if omitted.

        Raises:
            BusError: If a motor did not confirm; all others were told nevertheless.
        """
        self._require_connection()
        chosen = self._chosen(joints)
        failures = self._on_port(lambda: release_at_once(self.bus, chosen))
        if failures:
            raise BusError(f"not every joint confirmed the release: {'; '.join(failures)}")

    def close(self) -> None:
        """Stop what moves and give the port back. The joints go on holding; never fails."""
        try:
            if self._connected and any(axis.on_its_way for axis in self.axes):
                self.stop()
        except RobotError:
            pass  # without a bus the arm stops by itself
        finally:
            self._connected = False
            self.bus.close()

    def state(self) -> ArmState:
        """Return what is known now; sends nothing."""
        return state_of(self.axes, self.servos, self.now(), trusted=self.trust_zero)

    def _chosen(self, joints: Sequence[str] | None) -> list[Axis]:
        for name in joints or ():
            refuse_unknown("joint", name, self.joints)
        return [axis for axis in self.axes if joints is None or axis.joint.name in joints]

    def _require_connection(self) -> None:
        if not self._connected:
            raise BusError("the arm is not connected: call connect first")
