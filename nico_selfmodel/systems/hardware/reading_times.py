"""When the encoders of a station were read: a look at what stood there before tells nothing new."""

from collections.abc import Iterator

from pydrake.systems.framework import Context, Diagram, System

READ_AT = "read_at"
"""Output port of what reads encoders: when each was last read, by a clock of its own [s]."""


class ReadingTimes:
    """The output ports `read_at` of a station and of all that it is composed of.

    A simulated one has none: its encoders are read when somebody looks at them.
    """

    def __init__(self, station: System) -> None:
        """Find the ports."""
        self._systems = [one for one in _parts(station) if one.HasOutputPort(READ_AT)]

    @property
    def are_known(self) -> bool:
        """Whether there is such a port."""
        return bool(self._systems)

    def oldest(self, context: Context) -> float:
        """Return when the joint whose last reading is the oldest was read [s].

        Args:
            context: Of the station.

        Raises:
            ValueError: If there is no such port.
        """
        return min(
            min(one.GetOutputPort(READ_AT).Eval(one.GetMyContextFromRoot(context)))
            for one in self._systems
        )


def _parts(system: System) -> Iterator[System]:
    """Return a system and all systems that it is composed of, at any depth."""
    yield system
    if isinstance(system, Diagram):
        for part in system.GetSystems():
            yield from _parts(part)
