"""One joint on its board: goals that never lie far ahead, positions that are believed, faults.

A board has no watchdog: it carries out the goal it has, whoever sent it. So it is never given a
goal further ahead than it may travel in the heartbeat time and stop. A host that lives moves the
goal on; when it dies, by whatever cause, the board arrives and stands still by itself.
"""

import math

from nico_selfmodel.errors import BusError, ServoFault
from nico_selfmodel.servos.pic_servo import PicServo
from nico_selfmodel.servos.servo_config import JointServo
from nico_selfmodel.servos.status import AuxiliaryFlag, Status, StatusFlag

_STILL = 16
"""What a joint that stands may move between two readings without a second look [counts]."""
_FRESH = 0.5
"""Share of the heartbeat that is left when a goal is moved on."""
_LOOKS = 5


class Axis:
    """A joint, its board, where it is and where it goes. Registers are the board's counts."""

    def __init__(self, joint: JointServo, module: PicServo, heartbeat: float) -> None:
        """Stand for a joint; sends nothing.

        Args:
            joint: Its configuration.
            module: Its board.
            heartbeat: How far ahead a goal may lie [s].
        """
        self.joint, self.module, self.heartbeat = joint, module, heartbeat
        self.status: Status | None = None
        """The last reply that was believed."""
        self.seen = -math.inf
        """When it came [s]."""
        self.enabled = False
        """Whether the servo is meant to be on."""
        self.zero_known = False
        self.lost: str | None = None
        """Why the board cannot be reached any more."""
        self.goal: int | None = None
        """Where the motion is to end [register]."""
        self.velocity = joint.max_velocity * joint.counts_per_radian
        """Of the motion under way [counts/s]."""
        self.acceleration = joint.max_acceleration * joint.counts_per_radian
        """[counts/s^2]."""
        self._sent: int | None = None
        """The goal that the board has."""
        self._sent_speeds: tuple[float, float] | None = None
        self._loaded = False
        """Whether the last reply came before the motion was started."""
        self._moving_until = -math.inf

    def __str__(self) -> str:
        return f"{self.joint.name} (module {self.module.address})"

    @property
    def position(self) -> int:
        """The last position that was believed [register].

        Raises:
            ServoFault: If there is none yet.
        """
        if self.status is None or self.status.position is None:
            raise ServoFault(f"{self} was not read yet: connect first")
        return self.status.position

    @property
    def largest_velocity(self) -> float:
        """The limit of the configuration [counts/s]."""
        return self.joint.max_velocity * self.joint.counts_per_radian

    @property
    def reach(self) -> float:
        """How far ahead a goal may lie [counts]: the heartbeat at full speed, and the braking."""
        return self.velocity * self.heartbeat + self.velocity**2 / (2.0 * self.acceleration)

    @property
    def on_its_way(self) -> bool:
        """Whether the goal has not been reached."""
        if self.goal is None:
            return False
        return self._sent != self.goal or not self._stands_at(self.goal)

    def _stands_at(self, goal: int) -> bool:
        status = self.status
        if status is None or not status.flags & StatusFlag.MOVE_DONE:
            return False
        return abs(self.position + (status.position_error or 0) - goal) <= 1

    @property
    def _idle_elsewhere(self) -> bool:
        """Whether the board stands, but not at the goal it was sent: it missed the start."""
        if self._loaded or self.status is None or self._sent is None:
            return False
        return bool(self.status.flags & StatusFlag.MOVE_DONE) and not self._stands_at(self._sent)

    def aim(self, goal: int, velocity: float, acceleration: float) -> None:
        """Set where to go; sends nothing.

        Args:
            goal: Within the limits [register].
            velocity: At most the limit [counts/s].
            acceleration: At most the limit [counts/s^2].
        """
        if goal != self.goal:
            self._sent = None
        self.goal, self.velocity, self.acceleration = goal, velocity, acceleration

    def forget_goal(self) -> None:
        """Have nowhere to go, and know nothing of what the board holds; sends nothing."""
        self.goal = self._sent = self._sent_speeds = None

    def next_goal(self) -> int | None:
        """Return the goal to send now [register], None where the board has the right one."""
        if self.goal is None:
            return None
        if self._sent == self.goal and not self._idle_elsewhere:
            return None
        ahead = max(-self.reach, min(self.reach, self.goal - self.position))
        wanted = round(self.position + ahead)
        if self._sent is None or self._idle_elsewhere:
            return wanted
        # A stale reading must not pull the goal back.
        if abs(self.goal - wanted) >= abs(self.goal - self._sent):
            return None
        # A goal costs the wire half as much again as a reading: not in every cycle.
        ahead_for = self.heartbeat - (self.reach - abs(self._sent - self.position)) / self.velocity
        return wanted if ahead_for < _FRESH * self.heartbeat else None

    def load(self) -> None:
        """Give the board the first goal of a motion, to be started with the group.

        A joint that has nowhere to go is given the place where it stands: a common start carries
        out whatever a board was loaded with last.

        Raises:
            BusError: If the board does not answer.
            ServoFault: If it reports a fault.
        """
        goal = self.next_goal()
        if goal is None:
            error = self.status.position_error if self.status else 0
            goal = self._sent if self._sent is not None else self.position + (error or 0)
        self._send(goal, start=False)
        self._loaded = True

    def refresh(self, *, alive: bool = True) -> None:
        """Move the goal on, or just read.

        Args:
            alive: Whether the host was heard of within the heartbeat.

        Raises:
            BusError: If the board does not answer.
            ServoFault: If it reports a fault or a position that cannot be.
        """
        goal = self.next_goal() if alive and self.enabled else None
        if goal is None:
            self.believe(self.module.poll())
        else:
            self._send(goal, start=True)

    def _send(self, goal: int, *, start: bool) -> None:
        speeds = (self.velocity, self.acceleration)
        fresh = (None, None) if self._sent_speeds == speeds else speeds
        self._sent_speeds = None
        self._moving_until = math.inf
        status = self.module.move_to(goal, *fresh, start=start)
        self._sent, self._sent_speeds = goal, speeds
        self.believe(status)

    def stopped(self) -> None:
        """Note that the board was told to stop: it may still brake for a while."""
        self.forget_goal()
        brake = self.velocity / self.acceleration
        self._moving_until = self._now() + brake + 0.1

    def believe(self, status: Status) -> None:
        """Take a reply over, after a second look where it says something unexpected.

        Raises:
            BusError: If the second look fails, or readings keep contradicting each other.
            ServoFault: If the board reports a fault.
        """
        self._loaded = False
        for _ in range(_LOOKS):
            if not self._surprising(status):
                break
            again = self.module.poll()
            if self._agree(status, again):
                status = again
                break
            self.module.bus.counts[self.module.address].implausible += 1
            status = again
        else:
            raise BusError(f"{self}: its positions contradict each other: check the wiring")
        self.status, self.seen = status, self._now()
        if not self.on_its_way:
            self._moving_until = min(self._moving_until, self.seen + 0.1)
        if fault := self.fault(status):
            raise ServoFault(f"{self}: {fault}")

    def _now(self) -> float:
        return self.module.bus.port.now()

    def _surprising(self, status: Status) -> bool:
        if self.fault(status):
            return True
        if self.status is None or status.position is None or self.status.position is None:
            return True
        now = self._now()
        moving = now <= self._moving_until
        allowed = _STILL + (1.2 * self.velocity * (now - self.seen + 0.05) if moving else 0.0)
        return abs(status.position - self.status.position) > allowed

    def _agree(self, one: Status, other: Status) -> bool:
        if one.position is None or other.position is None:
            return False
        # Between the two looks even a limp arm that is pushed moves little.
        allowed = _STILL + 4.0 * self.largest_velocity * 0.05
        return abs(one.position - other.position) <= allowed and bool(self.fault(one)) == bool(
            self.fault(other)
        )

    def fault(self, status: Status) -> str | None:
        """Return what is wrong with a board whose servo is meant to be on, None if nothing is."""
        if not self.enabled:
            return None
        flags = status.flags
        if flags & StatusFlag.OVERCURRENT:
            return "over-current: something blocks the joint; free it, then enable it again"
        if not flags & StatusFlag.POWER_ON:
            return "no motor power: emergency stop? Restore it, then enable the joint again"
        servo_on = status.auxiliary is None or status.auxiliary & AuxiliaryFlag.SERVO_ON
        if flags & StatusFlag.POSITION_ERROR:
            limit = self.joint.gains.error_limit
            return (
                f"position error above {limit} counts: the joint is blocked or overloaded; free "
                "it, then enable it again"
            )
        if not servo_on:
            return "its servo is off though nobody switched it off; enable it again"
        return None
