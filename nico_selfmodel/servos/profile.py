"""Trapezoidal motion profiles, tick by tick, in the integers of a servo's chip."""

import math
from enum import Enum

UNITS_PER_COUNT = 65536
LARGEST_PWM_VELOCITY = 20 * UNITS_PER_COUNT
"""Speed at full PWM, without a load: this simulation's own choice."""


class Motion(Enum):
    """What moves the commanded position."""

    OFF = "off"
    HOLD = "hold"
    TRAPEZOID = "trapezoid"
    VELOCITY = "velocity"
    PWM = "pwm"


class Profile:
    """The commanded position, one servo tick after another. 65536 units are one count.

    Goal, velocity and acceleration may change on the fly, as with version 10 and later. How the
    real chip ends a move to the last unit is not public; this one never passes its goal.
    """

    def __init__(self) -> None:
        """Start at rest at zero."""
        self.motion = Motion.OFF
        self.position = 0
        self.velocity = 0
        self.goal = 0
        self.target_velocity = 0
        """Magnitude in a trapezoid, signed in velocity mode."""
        self.acceleration = UNITS_PER_COUNT

    @property
    def at_rest(self) -> bool:
        """Whether a tick would change nothing."""
        return self.velocity == 0 and self.motion in (Motion.OFF, Motion.HOLD)

    @property
    def counts(self) -> int:
        """Commanded position [counts]."""
        return self.position >> 16

    @property
    def move_done(self) -> bool:
        """What the status byte says: nothing to accelerate or arrive at any more."""
        if self.motion == Motion.TRAPEZOID:
            return False
        if self.motion == Motion.VELOCITY:
            return self.velocity == self.target_velocity
        return True

    def switch_off(self) -> None:
        """Let go of the motor."""
        self.motion, self.velocity = Motion.OFF, 0

    def hold(self) -> None:
        """Stop at once and hold."""
        self.motion, self.velocity = Motion.HOLD, 0
        self.position = self.counts * UNITS_PER_COUNT

    def stop_smoothly(self) -> None:
        """Decelerate at the current acceleration, then hold."""
        if self.velocity == 0 or self.motion == Motion.PWM:
            self.hold()
            return
        self.motion, self.target_velocity = Motion.VELOCITY, 0

    def place(self, counts: int) -> None:
        """Be at a position without having moved there."""
        self.position = counts * UNITS_PER_COUNT

    def tick(self) -> None:
        """Advance by one servo tick."""
        if self.motion == Motion.TRAPEZOID:
            self._tick_trapezoid()
        elif self.motion == Motion.VELOCITY:
            self._approach(self.target_velocity)
            self.position += self.velocity
            if self.velocity == 0 == self.target_velocity:
                self.hold()
        elif self.motion == Motion.PWM:
            self.position += self.velocity

    def _approach(self, wanted: int) -> None:
        a = self.acceleration
        self.velocity += max(-a, min(a, wanted - self.velocity))

    def _tick_trapezoid(self) -> None:
        distance, a = self.goal - self.position, self.acceleration
        # The largest speed from which steps of `a` still come to rest within the distance.
        stopping = (math.isqrt(a * a + 8 * a * abs(distance)) - a) // 2
        speed = min(self.target_velocity, stopping)
        if abs(distance) <= a and abs(self.velocity) <= a:
            self.position, self.velocity, self.motion = self.goal, 0, Motion.HOLD
            return
        self._approach(speed if distance > 0 else -speed)
        self.position += self.velocity


class TimedProfile(Profile):
    """A profile that is told times and counts, and does its ticks by itself."""

    _TICK = 2e-3

    def __init__(self, time: float) -> None:
        """Be off at zero at a time [s]."""
        super().__init__()
        self._time = time

    @property
    def counts(self) -> int:
        """Commanded position, rounded [counts]."""
        return (self.position + UNITS_PER_COUNT // 2) // UNITS_PER_COUNT

    def advance(self, time: float) -> None:
        """Do the ticks up to a time [s]."""
        ticks = int((time - self._time) / self._TICK)
        if ticks <= 0:
            return
        self._time += ticks * self._TICK
        for _ in range(ticks):
            if self.at_rest:
                return
            self.tick()

    def go(self, goal: int, velocity: float, acceleration: float) -> None:
        """Go to a place [counts] at a speed [counts/s] and acceleration [counts/s^2]."""
        self.target_velocity = max(1, round(velocity * self._TICK * UNITS_PER_COUNT))
        self.acceleration = max(1, round(acceleration * self._TICK**2 * UNITS_PER_COUNT))
        self.goal = goal * UNITS_PER_COUNT
        at_goal = self.velocity == 0 and self.position == self.goal
        self.motion = Motion.HOLD if at_goal else Motion.TRAPEZOID

    @property
    def rate(self) -> float:
        """How fast it moves [counts/s]."""
        return self.velocity / UNITS_PER_COUNT / self._TICK
