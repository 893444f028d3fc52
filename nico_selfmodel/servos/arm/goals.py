"""Which goal a board may be given now: none that it would not stand at in time if its host died.

A board has no watchdog: it carries out the goal it has, whoever sent it. So a goal lies no further
ahead than the board travels in the heartbeat time, and the way it needs to brake. A host that lives
moves the goal on; when it dies, by whatever cause, the board arrives and stands still by itself.
"""

import math

from nico_selfmodel.servos.arm.servo_config import JointServo
from nico_selfmodel.servos.arm.trapezoid import duration

_FRESH = 0.5
"""Share of the heartbeat that is left when a goal is moved on."""
_LOAD = math.radians(2.0)
"""How far a joint may hang behind its board's command for a goal to be moved on [rad]."""
_FASTER, _MUCH_FASTER = 1.1, 2.0
"""A joint that goes so many times its speed is to slow down; so many times, before all else."""
_LEAD = 0.1
"""How much later than it is loaded a motion may be started [s]."""
_COUNTING = 2
"""Steps that say nothing of a speed: counts are whole numbers."""
_LONG = 1.0
"""Readings farther apart say nothing of a speed [s]."""
_FEW = 0.1
"""Share of its reach that a joint must be able to go ahead for a goal to make sense."""


class Goals:
    """Where a joint is to go, what its board was told of it, and where the board is on the way.

    All places are registers, in counts; `commanded` is where the board wants the joint to be.
    """

    def __init__(self, joint: JointServo, heartbeat: float) -> None:
        """Have nowhere to go.

        Args:
            heartbeat: How far ahead a goal may lie [s].
        """
        self.heartbeat = heartbeat
        self.goal: int | None = None
        """Where the motion is to end."""
        self.velocity = joint.max_velocity * joint.counts_per_radian
        """Of the motion under way [counts/s]."""
        self.acceleration = joint.largest_acceleration
        """[counts/s^2]."""
        self.sent: int | None = None
        """The goal that the board has."""
        self.braking = False
        """Whether the board was told to slow down before it gets its goal."""
        self.loaded = False
        """Whether the last reading was made before the motion was started."""
        self.commanded = self.position = 0
        """Where the board wanted the joint to be at the last reading, and where it was."""
        self._lag = min(0.5 * joint.gains.error_limit, _LOAD * joint.counts_per_radian)
        self._standing, self._seen = True, -math.inf
        self._step, self._rate = 0, 0.0
        """How far the command went between the last two readings [counts, counts/s]."""
        self._told = 0.0
        """Largest speed of what the board was told last, 0 when it stands [counts/s]."""
        self._fastest, self._fastest_at = 0.0, -math.inf
        """Speed that the board had at most when it was last told another, and when."""

    @property
    def reach(self) -> float:
        """How far a goal may lie ahead [counts]: the heartbeat at full speed, and the braking."""
        return self.velocity * self.heartbeat + self.velocity**2 / (2.0 * self.acceleration)

    @property
    def reached(self) -> bool:
        """Whether the board has the goal and stands there, or there is none."""
        return self.goal is None or (self.sent == self.goal and self._stands_at(self.goal))

    def _stands_at(self, goal: int) -> bool:
        return self._standing and abs(self.commanded - goal) <= 1

    @property
    def _idle_elsewhere(self) -> bool:
        """Whether the board stands, but not at the goal it was sent: it missed the start."""
        if self.loaded or self.sent is None:
            return False
        return self._standing and not self._stands_at(self.sent)

    def aim(self, goal: int, velocity: float, acceleration: float, now: float) -> bool:
        """Set where to go; return whether this is anything new.

        Args:
            goal: Within the limits.
            velocity: At most the limit [counts/s].
            acceleration: At most the limit [counts/s^2].
            now: Time [s].
        """
        if (goal, velocity, acceleration) == (self.goal, self.velocity, self.acceleration):
            return False
        slower = self.acceleration * (now - self._fastest_at)
        fastest = 0.0 if self.reached else max(self.velocity, self._fastest - slower)
        self._fastest, self._fastest_at, self.sent = fastest, now, None
        self.goal, self.velocity, self.acceleration = goal, velocity, acceleration
        return True

    def forget(self) -> None:
        """Have nowhere to go, and know nothing of what the board holds."""
        self.goal = self.sent = None
        self.braking, self._told = False, 0.0

    def note(self, now: float, commanded: int, position: int, *, standing: bool) -> None:
        """Take a reading.

        Args:
            now: When it was made [s].
            commanded: Where the board wanted the joint to be.
            position: Where it was.
            standing: Whether the board had nothing more to do.
        """
        pause = now - self._seen
        self._step = commanded - self.commanded if 0.0 < pause <= _LONG else 0
        self._rate = self._step / pause if self._step else 0.0
        self.commanded, self.position = commanded, position
        self._standing, self._seen, self.loaded = standing, now, False
        if standing:
            self._told = 0.0

    def next(self, now: float) -> int | None:
        """Return the goal to send now, None where the board has the right one."""
        if self.goal is None:
            return None
        if self.sent == self.goal and not self._idle_elsewhere:
            return None
        wanted = self._within_reach(self.goal, now)
        if self.sent is None or self._idle_elsewhere:
            return wanted
        # A stale reading must not pull the goal back.
        if abs(self.goal - wanted) >= abs(self.goal - self.sent):
            return None
        # A goal costs the wire half as much again as a reading: not in every cycle.
        ahead = (self.sent - self.commanded) * (1 if self.goal > self.commanded else -1)
        ahead_for = self.heartbeat - (self.reach - ahead) / self.velocity
        return wanted if ahead_for < _FRESH * self.heartbeat else None

    def brakes_first(self, now: float) -> bool:
        """Return whether the joint is so fast that no goal can be set that it stands at in time."""
        if self.goal is None:
            return False
        rate = abs(self._rate) if abs(self._step) > _COUNTING else 0.0
        soon = now - self._seen + _LEAD
        largest = max(rate, min(self._told, rate + self.acceleration * soon))
        if largest > _MUCH_FASTER * self.velocity:
            return True
        return rate > 0.0 and self._room(self.goal, now)[1] < _FEW * self.reach

    def was_sent(self, goal: int, *, start: bool) -> None:
        """Note that the board took a goal, to go there now or with its group."""
        self.sent, self.braking, self.loaded = goal, False, not start
        self._told = self.velocity if start else max(self._told, self.velocity)

    def was_braked(self, *, start: bool) -> None:
        """Note that the board was told to slow down, now or with its group."""
        self.sent, self.braking, self.loaded, self._told = None, True, not start, 0.0

    def longest(self, now: float) -> float:
        """Return how long the motion takes at most from now, begun the other way at worst [s]."""
        if self.goal is None:
            return 0.0
        v, a = self._fastest, self.acceleration
        way = abs(self.goal - self.commanded) + v**2 / (2.0 * a)
        return duration(way, self.velocity, a) + v / a

    def _within_reach(self, goal: int, now: float) -> int:
        """Return what is within reach of a goal.

        From where the board commands the joint to be, so that one that a load pulls back gets on;
        but where it hangs back too far, it is not commanded on against what holds it.
        """
        back, ahead = self._room(goal, now)
        toward = 1.0 if goal > self.commanded else -1.0
        within = toward * min(toward * goal, toward * self.commanded + ahead - back)
        lag = max(self.reach, self._lag)
        return round(max(self.position - lag, min(self.position + lag, within)))

    def _room(self, goal: int, now: float) -> tuple[float, float]:
        """Return how far a joint first goes the other way, and then may go ahead [counts].

        One that is on the way back has to turn round first, and one that is faster than it shall be
        must not be made to.
        """
        v, a = self.velocity, self.acceleration
        rate = self._rate if goal > self.commanded else -self._rate
        braking, stale = rate**2 / (2.0 * a), abs(rate) * (now - self._seen)
        if rate < 0.0:
            spare = (1.5 * max(v, -rate) + rate - v) / a
            return braking, v * (self.heartbeat + spare) - stale
        if rate <= _FASTER * v:
            return 0.0, self.reach
        return 0.0, v * self.heartbeat + max(braking, v**2 / (2.0 * a)) + stale
