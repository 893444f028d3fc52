"""One joint on its motor: goals that are moved on, positions that are trusted, faults."""

import math
from collections.abc import Sequence

import numpy as np

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.servos.arm.goals import Goals
from nico_selfmodel.servos.arm.jam_watch import JamWatch
from nico_selfmodel.servos.arm.motor import Motor, Reading
from nico_selfmodel.servos.arm.servo_config import JointServo
from nico_selfmodel.servos.arm_state import ArmState
from nico_selfmodel.servos.ports import Port

_OFTEN = 0.25
"""Share of the heartbeat within which a board must be read to be served without a pause."""
_LOOKS = 5


class Axis:
    """A joint, its motor, where it is and where it goes. Registers are the motor's counts."""

    def __init__(self, joint: JointServo, motor: Motor, port: Port, heartbeat: float) -> None:
        """Stand for a joint; sends nothing.

        Args:
            port: Of the motor's bus, for its time.
            heartbeat: How far ahead a goal may lie [s].
        """
        self.joint, self.motor, self.heartbeat = joint, motor, heartbeat
        self._port = port
        self.last: Reading | None = None
        """The last reading that was trusted."""
        self.seen = -math.inf
        """When it came [s]."""
        self.enabled = False
        """Whether the servo is meant to be on."""
        self.zero_known = False
        self.lost: str | None = None
        """Why the board cannot be reached any more."""
        self.drifts = False
        """Whether it moved between the last two readings though its servo is off."""
        self.goals = Goals(joint, heartbeat)
        """Where the joint is to go, and what its board was told of it."""
        self._jams = JamWatch(joint.counts_per_radian)
        self._sent_speeds: tuple[float, float] | None = None
        self._moving_until = -math.inf
        self._due_known = True
        """Whether it was worked out when the motion under way will be over."""

    def __str__(self) -> str:
        return str(self.joint)

    @property
    def position(self) -> int:
        """The last position that was trusted [register].

        Raises:
            ServoFault: If there is none yet.
        """
        return self._reading().position

    @property
    def commanded(self) -> int:
        """Where the board wanted the joint to be at the last reading [register].

        Raises:
            ServoFault: If there is none yet.
        """
        return self._reading().commanded

    def _reading(self) -> Reading:
        if self.last is None:
            raise ServoFault(f"{self} was not read yet: connect first")
        return self.last

    @property
    def largest_velocity(self) -> float:
        """The limit of the configuration [counts/s]."""
        return self.joint.max_velocity * self.joint.counts_per_radian

    @property
    def on_its_way(self) -> bool:
        """Whether the goal has not been reached."""
        if self.goals.goal is None:
            return False
        return self.last is None or not self.goals.reached or self._jams.behind

    def aim(self, goal: int, velocity: float, acceleration: float) -> None:
        """Set where to go; sends nothing.

        Args:
            goal: Within the limits [register].
            velocity: At most the limit [counts/s].
            acceleration: At most the limit [counts/s^2].
        """
        if self.goals.aim(goal, velocity, acceleration, self._now()):
            self._due_known = False
            self._jams.arrived()

    def forget_goal(self) -> None:
        """Have nowhere to go, and know nothing of what the board holds; sends nothing."""
        self.goals.forget()
        self._sent_speeds, self._due_known = None, True
        self._jams.arrived()

    def begin_anew(self) -> None:
        """Note that the board's command is where the joint stands: switched on, or zeroed."""
        self._jams.forget()

    def load(self) -> None:
        """Give the board the first goal of a motion, to be started with the group.

        A joint that has nowhere to go is given the place where it stands: a common start carries
        out whatever a board was loaded with last.

        Raises:
            BusError: If the board does not answer.
            ServoFault: If it reports a fault.
        """
        goals, now = self.goals, self._now()
        goal = goals.next(now)
        if goals.brakes_first(now):
            self._brake(start=False)
            return
        goal = goals.sent if goal is None else goal
        self._send(self.commanded if goal is None else goal, start=False)

    def refresh(self, *, alive: bool = True) -> None:
        """Move the goal on, or just read.

        Args:
            alive: Whether the host was heard of within the heartbeat.

        Raises:
            BusError: If the board does not answer.
            ServoFault: If it reports a fault or a position that cannot be, or the joint is blocked.
        """
        goals, now = self.goals, self._now()
        goal = goals.next(now) if alive and self.enabled else None
        too_fast = goal is not None and goals.brakes_first(now)
        if too_fast and not goals.braking:
            self._brake(start=True)
        elif goal is None or too_fast or (goals.braking and goals.loaded):
            self.accept(self.motor.poll())
        else:
            self._send(goal, start=True)
        if not self._due_known:
            self._jams.expect(self._now(), goals.longest(self._now()))
            self._due_known = True

    def _brake(self, *, start: bool) -> None:
        """Slow down; the goal is sent when the joint is slow enough for it."""
        self._sent_speeds, self._moving_until = None, math.inf
        self.accept(self.motor.brake(self.goals.acceleration, start=start))
        self.goals.was_braked(start=start and self.motor.answers)

    def _send(self, goal: int, *, start: bool) -> None:
        speeds = (self.goals.velocity, self.goals.acceleration)
        fresh = (None, None) if self._sent_speeds == speeds else speeds
        self._sent_speeds, self._moving_until = None, math.inf
        reading = self.motor.move_to(goal, *fresh, start=start)
        self._sent_speeds = speeds
        self.accept(reading)
        self.goals.was_sent(goal, start=start and self.motor.answers)

    def stopped(self) -> None:
        """Note that the motor was told to stop: it may still brake for a while."""
        self.forget_goal()
        brake = self.goals.velocity / self.goals.acceleration
        self._moving_until = self._now() + brake + 0.1

    def accept(self, reading: Reading) -> None:
        """Take a reading over, after a second look where it says something unexpected.

        Raises:
            BusError: If the second look fails, or readings keep contradicting each other.
            ServoFault: If the motor reports a fault.
        """
        for _ in range(_LOOKS):
            if not self._surprising(reading):
                break
            looked = self._now()
            again = self.motor.look_again(reading)
            agree = self._agree(reading, again, self._now() - looked)
            reading = again
            if agree:
                break
            self.motor.counts.implausible += 1
        else:
            raise BusError(f"{self}: its positions contradict each other: check the wiring")
        now = self._now()
        went = 0 if self.last is None else abs(reading.position - self.last.position)
        self.drifts = not self.enabled and went > self.joint.still
        pause, self.last, self.seen = now - self.seen, reading, now
        self.goals.note(now, reading.commanded, reading.position, standing=reading.standing)
        if not self.on_its_way:
            self._moving_until = min(self._moving_until, self.seen + 0.1)
        if fault := self.fault(reading) or self._stuck(pause):
            raise ServoFault(f"{self}: {fault}")

    def _stuck(self, pause: float) -> str | None:
        """Return what keeps the joint from getting on after the reading just made, if anything.

        Args:
            pause: Time since the one before [s].
        """
        if not self.enabled:
            self._jams.forget()
            return None
        blocked = self._jams.note(self.seen, self.commanded, self.position, self.goals.velocity)
        if pause > _OFTEN * self.heartbeat:
            self._jams.delay(pause)
        if pause > self.heartbeat:  # it has stopped, and gets going again
            self._jams.delay(self.goals.velocity / self.goals.acceleration)
        if not self.on_its_way:
            self._jams.arrived()
        return blocked or self._jams.overdue(self.seen)

    def _now(self) -> float:
        return self._port.now()

    def _surprising(self, reading: Reading) -> bool:
        if self.last is None or self.motor.doubtful or self.fault(reading):
            return True
        now = self._now()
        moving = now <= self._moving_until
        way = 1.2 * self.goals.velocity * (now - self.seen + 0.05) if moving else 0.0
        return abs(reading.position - self.last.position) > self.joint.still + way

    def _agree(self, one: Reading, other: Reading, seconds: float) -> bool:
        # Between the two looks even a limp arm that is pushed moves little.
        allowed = self.joint.still + 4.0 * self.largest_velocity * min(0.05, seconds + 0.01)
        return abs(one.position - other.position) <= allowed and bool(self.fault(one)) == bool(
            self.fault(other)
        )

    def fault(self, reading: Reading) -> str | None:
        """Return what is wrong with a motor that is meant to hold, None if nothing is."""
        return reading.fault if self.enabled else None


def state_of(
    axes: Sequence[Axis], servos: ServoMap, now: float, *, trusted: bool = False
) -> ArmState:
    """Return what is known of axes.

    Args:
        axes: In the order of `servos`.
        servos: Readings <-> displacements.
        now: Time of the port [s].
        trusted: Whether zeros count as known though they were not set since power-up.
    """
    readings = np.array(
        [np.nan if a.last is None else a.joint.reading(a.last.position) for a in axes]
    )
    zero_known = np.array([axis.zero_known or trusted for axis in axes])
    trouble = tuple(
        axis.lost or (axis.fault(axis.last) if axis.last else "not read yet") for axis in axes
    )
    return ArmState(
        time=now,
        joints=servos.joints,
        q=np.where(zero_known, servos.to_joint(readings), np.nan),
        readings=readings,
        age=np.array([now - axis.seen for axis in axes]),
        valid=np.array([reason is None for reason in trouble]),
        moving=np.array([axis.on_its_way or axis.drifts for axis in axes]),
        enabled=np.array([axis.enabled for axis in axes]),
        zero_known=zero_known,
        trouble=trouble,
    )
