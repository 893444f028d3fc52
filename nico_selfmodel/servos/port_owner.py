"""What every bus is, whatever its make: the one owner of a port, and how well the port works."""

import math
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from nico_selfmodel.servos.bus_settings import NOISY_FOR, BusSettings, NoisyLineError
from nico_selfmodel.servos.link_counts import LinkCounts, sum_of
from nico_selfmodel.servos.ports import Port
from nico_selfmodel.with_blocks import ClosedAtEnd

_NOISE_LIMIT = 1.0
"""How long a line is waited for to become quiet [s]."""
_HURRIED = 0.1
"""The same where somebody waits for a stop [s]."""


class PortOwner(ClosedAtEnd):
    """Exchanges with motors, one at a time, from any thread."""

    def __init__(self, port: Port, settings: BusSettings | None = None) -> None:
        """Take a port over; sends nothing.

        Args:
            port: An open port that nobody else reads or writes.
        """
        self.port = port
        self.settings = settings or BusSettings()
        self.counts: dict[int, LinkCounts] = defaultdict(LinkCounts)
        """By address."""
        self._lock = threading.RLock()
        self._doubtful = True  # what the line did before is not known
        self._damaged_at = -math.inf
        self._noise_limit = _NOISE_LIMIT

    def close(self) -> None:
        """Give the port back; never fails."""
        self.port.close()

    @property
    def noisy(self) -> bool:
        """Whether the line damaged something lately: a checksum alone is not trusted then."""
        return self.port.now() - self._damaged_at < NOISY_FOR

    @contextmanager
    def hurried(self) -> Iterator[None]:
        """Ask everybody but once, and wait for a noisy line but shortly: something has to stop."""
        settings = self.settings
        self.settings, self._noise_limit = replace(settings, attempts=1), _HURRIED
        try:
            yield
        finally:
            self.settings, self._noise_limit = settings, _NOISE_LIMIT

    def total(self) -> LinkCounts:
        """Return the sum of the counts of all motors."""
        return sum_of(list(self.counts.values()))

    def _note_damage(self, counts: LinkCounts) -> None:
        counts.damaged += 1
        self._damaged_at = self.port.now()

    def _until_quiet(self, quiet: float) -> int:
        """Read until nothing has come for a time [s]; return how many bytes came.

        Raises:
            NoisyLineError: If the line never becomes quiet.
        """
        stray, until = 0, self.port.now() + self._noise_limit
        while arrived := self.port.read(1, quiet):
            stray += len(arrived) + len(self.port.read(4096, 0.0))
            if self.port.now() > until:
                raise NoisyLineError(
                    f"{self.port.name} never gets quiet: check the baud rate and the wiring"
                )
        return stray
