"""The servos of an arm as a Drake system: a thread owns the bus, the diagram copies its news."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.servos import ArmController, ArmLoop, ServoConfig
from nico_selfmodel.servos.arm.pose_limits import PoseLimits
from nico_selfmodel.servos.arm_state import ArmState
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.systems.hardware.reading_times import READ_AT
from nico_selfmodel.with_blocks import OpenedAtStart

PERIOD = 0.02
"""Time between two looks at what the bus thread knows [s]."""
_STALE = 0.5
"""A reading that is older says nothing about now [s]."""
_AGE, _VALID = (ArmState.ROWS.index(name) for name in ("age", "valid"))
_READ_AT = len(ArmState.ROWS)
"""What the diagram holds of each joint besides."""


class ServoDriver(OpenedAtStart, LeafSystem):
    """Drives the joints of a servo configuration, in their order.

    | port | | carries |
    |---|---|---|
    | `encoders_commanded` | in | where joints shall go [counts]; those at nan are not commanded |
    | `q_measured` | out | their angles by the servo map [rad]; nan where not valid or not homed |
    | `encoders` | out | encoder readings [counts]; nan where not valid |
    | `valid` | out | 1 where a joint was read lately and has no fault, else 0 |
    | `age` | out | how old each reading is [s] |
    | `read_at` | out | when each joint was last read, by the bus thread's clock [s] |
    | `moving` | out | 1 where a joint is on its way, else 0 |
    | `status` | out | what each joint does, in words: a tuple of texts |

    Making one opens nothing; `open` finds the motors, of the make that the configuration names, and
    starts to read, `enable` switches them on, and only then a command moves the arm, from
    `Simulator.Initialize` on. What the bus fails with is raised from `Simulator.AdvanceTo` with its
    cause. The diagram is the heartbeat: when it stands still for longer than the configuration
    allows, the arm stops. The arm lives in real time; run the diagram at
    `set_target_realtime_rate(1.0)`.
    """

    def __init__(
        self,
        port: str,
        config: ServoConfig,
        servos: ServoMap | None = None,
        *,
        trust_zero: bool = False,
        speed: float | None = None,
        period: float = PERIOD,
        settings: BusSettings | None = None,
    ) -> None:
        """Describe an arm.

        Args:
            port: Serial port: `/dev/serial/by-id/...`, or of a `SimulatedBus`.
            servos: Of its self-model; gears of 1 and zeros of 0 if omitted.
            trust_zero: Accept commands though a zero was not set since power-up.
            speed: Largest joint speed [rad/s]; the limits if omitted.
            period: Time between two updates, and the least of the bus thread's cycles [s].
            settings: How patient the bus is; a lost board is noticed later by a patient one.

        Raises:
            ValueError: If the self-model is about other joints or encoders, the speed is beyond
                every limit, or the period is not positive.
        """
        super().__init__()
        if not period > 0.0:
            raise ValueError(f"period must be positive, got {period}")
        self.port, self.config, self.period = port, config, period
        self.servos = config.servo_map(servos)
        self.joints = config.joint_names
        PoseLimits(config, self.servos).speed(speed)
        self._trust_zero, self._speed, self._settings = trust_zero, speed, settings
        self._loop: ArmLoop | None = None
        self._handed = b""
        """The command that the bus thread has."""
        n = len(self.joints)
        self._command = self.DeclareVectorInputPort("encoders_commanded", n)
        unknown = np.full((len(ArmState.ROWS) + 1, n), np.nan)
        unknown[_VALID:] = 0.0
        unknown[_AGE], unknown[_READ_AT] = np.inf, -np.inf
        self.DeclareDiscreteState(unknown.ravel())
        self.DeclareInitializationDiscreteUpdateEvent(self._take_over)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._take_over)
        self.DeclarePeriodicPublishEvent(period, 0.0, self._hand_over)
        known = {self.xd_ticket()}
        names = ("q_measured", "encoders", "valid", "age", "moving")
        for row, name in enumerate(names):
            self.DeclareVectorOutputPort(name, BasicVector(n), self._writer(row), known)
        self.DeclareVectorOutputPort(READ_AT, BasicVector(n), self._writer(_READ_AT), known)
        self.DeclareAbstractOutputPort(
            "status", lambda: AbstractValue.Make(()), self._describe, known
        )

    @property
    def is_open(self) -> bool:
        """Whether the port is open and read."""
        return self._loop is not None

    @property
    def cycles(self) -> int:
        """How often the bus thread has read every joint since `open`."""
        return 0 if self._loop is None else self._loop.cycles

    def open(self) -> tuple[str, ...]:
        """Open the port, find the boards and start to read. Switches nothing on, moves nothing.

        Returns:
            Joints whose zero is not known: they must be homed before they can be commanded.

        Raises:
            RobotError: If it is open already, the port cannot be opened, or a board is missing.
        """
        if self._loop is not None:
            raise RobotError(f"{self.port} is open already: close it first")
        arm = ArmController.open(
            self.port,
            self.config,
            self.servos,
            trust_zero=self._trust_zero,
            settings=self._settings,
        )
        loop = ArmLoop(arm, self.period)
        try:
            due = arm.connect()
            loop.start()
        except BaseException:
            loop.close()  # the thread too, if it runs
            raise
        self._loop, self._handed = loop, b""
        return due

    def enable(self) -> None:
        """Switch the servos on where the joints stand. Nothing moves.

        Raises:
            RobotError: If it is not open, or one cannot be switched on.
        """
        self._running().call(lambda arm: arm.enable())

    def stop(self) -> None:
        """Stop every joint and hold; a diagram that goes on commanding starts it again.

        Raises:
            RobotError: If it is not open, or a joint did not confirm.
        """
        self._running().stop()

    def state(self) -> ArmState:
        """Return the newest state, for use outside a diagram; sends nothing.

        Raises:
            RobotError: If it is not open, or what the bus thread failed with.
        """
        state = self._running().state()
        assert state is not None  # the thread was started, which waits for the first
        return state

    def close(self) -> None:
        """Stop what moves and give the port back. The joints go on holding; never fails."""
        loop, self._loop = self._loop, None
        if loop is not None:
            loop.close()

    def _running(self) -> ArmLoop:
        if self._loop is None:
            raise RobotError(
                f"the servo driver of {self.port} is not open: call open first, or use it in a "
                "with block"
            )
        return self._loop

    def _take_over(self, context: Context, update: DiscreteValues) -> None:
        """Copy what the bus thread knows, which took care of all but the time since then."""
        loop = self._running()
        state = loop.state()
        assert state is not None  # the thread was started, which waits for the first
        since = loop.arm.now() - state.time
        rows = np.vstack([state.rows, state.time - state.age])
        rows[_AGE] += since
        if state.oldest + since >= _STALE:
            rows[_VALID, rows[_AGE] >= _STALE] = 0.0
            rows[:_VALID, rows[_VALID] == 0.0] = np.nan
        update.set_value(rows.ravel())

    def _hand_over(self, context: Context) -> None:
        """Give the bus thread the command; it is also a sign of life."""
        loop = self._running()
        if not self._command.HasValue(context):
            loop.heartbeat()
            return
        readings = np.asarray(self._command.Eval(context), dtype=float)
        if (handed := readings.tobytes()) == self._handed:
            loop.repeat()
        else:
            meant = np.flatnonzero(~np.isnan(readings))
            q = self.servos.to_joint(readings)
            loop.command(q, speed=self._speed, joints=meant.tolist())
            self._handed = handed

    def _row(self, context: Context, row: int) -> NDArray:
        n = len(self.joints)
        return context.get_discrete_state_vector().value()[row * n : (row + 1) * n]

    def _writer(self, row: int) -> Callable[[Context, BasicVector], None]:
        return lambda context, vector: vector.SetFromVector(self._row(context, row))

    def _describe(self, context: Context, value: AbstractValue) -> None:
        rows = [self._row(context, row) for row in range(_VALID, len(ArmState.ROWS))]
        value.set_value(tuple(_words(*column) for column in zip(*rows, strict=True)))


def _words(valid: float, age: float, moving: float, enabled: float, zero_known: float) -> str:
    """Return what a joint does."""
    if not np.isfinite(age):
        return "not read yet"
    if not valid:
        return f"not read for {age:.1f} s"
    words = "moving" if moving else "holding" if enabled else "off"
    return words if zero_known else f"{words}, not homed"
