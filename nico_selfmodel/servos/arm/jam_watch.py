"""Whether a joint follows what its board commands, and arrives in time: a jam is noticed here.

A board switches its servo off only when the position error passes its limit, which may be degrees
away. A joint that is blocked while it moves slowly, or near its goal, never gets there.
"""

import math

MARGIN = 0.5
"""How long after the planned end of a motion its board may still be on the way [s]."""
_PATIENCE = 0.7
"""How long a joint may stay behind what its board commands [s]."""
_SLOWEST = math.radians(1.0)
"""Below this speed patience grows: friction takes as many counts, and those more time [rad/s]."""
_FRICTION = math.radians(0.3)
"""What friction may keep a healthy joint behind by [rad]."""
_TURNING = 2.5
"""So many times that where it starts or turns round: friction changes sides, and a lag is left."""
_COUNTS = 3.0
"""The same of a coarse encoder [counts]."""
_HALF, _FULL = 0.5, 0.9
"""Shares of the commanded way below which a joint is behind, and above which it kept up."""
_LONGEST_STEP = 0.25
"""Time between two readings that counts, however long it was [s]: the host may have slept."""
_TWITCH = 0.1
"""Share of that which readings may move by though the joint does not."""
_SECOND = 1.0
_ROUNDING = 1.02
"""Boards round speeds: a planned time may be this much longer."""


class JamWatch:
    """Compares the way that a joint went with the way that its board commanded.

    The commanded place is read from the board with every position (position + position error), so
    that whatever the host does, too slow, goals that replace each other, a stop, is the board's
    way too. Both are measured from an anchor: the last reading at which the joint had kept up.
    A load only shifts the position and a lag only delays it; a joint that is jammed stays.
    """

    def __init__(self, counts_per_radian: float) -> None:
        """Know nothing yet.

        Args:
            counts_per_radian: Of the joint's encoder.
        """
        self._slack = max(_FRICTION * counts_per_radian, _COUNTS)
        self._slowest = _SLOWEST * counts_per_radian
        self._per_degree = counts_per_radian * math.pi / 180.0
        self._due = math.inf
        self.forget()

    def forget(self) -> None:
        """Begin anew: the joint was switched on, or its zero was set."""
        self._anchor: tuple[float, int, int, int] | None = None
        self._time, self._moved = math.inf, -math.inf
        self._last = 0
        """Where the board commanded the joint to be when that last changed."""
        self._behind_for = -1.0
        self._due = math.inf

    @property
    def behind(self) -> bool:
        """Whether the joint went less than half of the way that its board commanded."""
        return self._behind_for >= 0.0

    def expect(self, now: float, seconds: float) -> None:
        """Note that a motion is to be over in some seconds [s]."""
        self._due = now + _ROUNDING * seconds + MARGIN

    def delay(self, seconds: float) -> None:
        """Note that the host did not serve the board for a time [s]."""
        self._due += seconds

    def arrived(self) -> None:
        """Note that nothing is on its way any more."""
        self._due = math.inf

    def overdue(self, now: float) -> str | None:
        """Return what is wrong where the last motion should be over by now, else None."""
        if now <= self._due:
            return None
        return (
            f"blocked or overloaded: its motion should have been over {MARGIN:g} s ago; free it, "
            "then enable it again"
        )

    def note(self, now: float, commanded: int, position: int, speed: float) -> str | None:
        """Take a reading.

        Args:
            now: When it was made [s].
            commanded: Where the board wanted the joint to be [counts].
            position: Where it was [counts].
            speed: Largest speed of the motion under way [counts/s].

        Returns:
            What is wrong, None while nothing is.
        """
        step = min(max(0.0, now - self._time), _LONGEST_STEP)
        self._time = now
        if abs(commanded - self._last) > 1:
            self._last, self._moved = commanded, now
        if self._anchor is None:
            self._anchor = (now, commanded, position, 0)
            return None
        since, c, p, came = self._anchor
        sign = 1 if commanded >= c else -1
        way, went = sign * (commanded - c), sign * (position - p)
        if went < -_TWITCH * self._slack:  # it still catches up the other way: it turns only here
            self._anchor, way, went = (since, commanded, position, came), 0, 0
        slack, went = self._slack * (1.0 if sign == came else _TURNING), max(went, 0)
        off = abs(commanded - position) > self._slack
        if off and min(way, way - went) > slack and went < _HALF * way:
            self._behind_for = 0.0 if self._behind_for < 0.0 else self._behind_for + step
            patience = _PATIENCE * max(1.0, self._slowest / speed)
            return self._words(way, went) if self._behind_for >= patience else None
        kept_up, old = way > slack and went >= _HALF * way, now - since > _SECOND
        self._catch_up(step, kept_up=kept_up)
        if kept_up and (went >= _FULL * way or old):
            self._anchor = (now, commanded, position, sign)
        elif now - self._moved > _SECOND and not self.behind:
            self._anchor = (now, commanded, position, 0)
        return None

    def _catch_up(self, step: float, *, kept_up: bool) -> None:
        """Forgive at once where the joint moved on, else as slowly as it was blamed."""
        # A jammed joint whose command swings to and fro is not behind when that passes by.
        left = -1.0 if kept_up else self._behind_for - step
        self._behind_for = left if left >= 0.0 else -1.0

    def _words(self, way: float, went: float) -> str:
        went, way = went / self._per_degree, way / self._per_degree
        return (
            f"blocked or overloaded: it went {went:.1f} of {way:.1f} deg and does not follow; free "
            "it, then enable it again"
        )
