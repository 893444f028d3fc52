"""Two robots of one station that move while somebody watches."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator

from nico_selfmodel.systems.stations.nico_station import NicoStation


class TimedCommands(Protocol):
    """Commands, each with its time."""

    def due(self, after: float, until: float) -> list[tuple[float, NDArray]]:
        """Return times [s] and commands of an interval, its end included."""
        ...


class MovingRobots:
    """A station in a context of its own, in which two robots carry out timed commands."""

    def __init__(self, station: NicoStation, own: TimedCommands, other: TimedCommands) -> None:
        """Take a station that was built with a second robot.

        Args:
            station: It; what else there is must be put there through `context`.
            own: What the robot is commanded.
            other: What the second one is, in the first one's encoder units.
        """
        self._station = station
        self._simulator = Simulator(station)
        self.context: Any = self._simulator.get_mutable_context()
        self._programs = {"encoders_commanded": own, "other_commanded": other}
        self._now = -1.0
        still = self.readings()
        for port in self._programs:
            station.GetInputPort(port).FixValue(self.context, still)
        self._simulator.Initialize()

    def readings(self) -> NDArray:
        """Return what the encoders read. Shape (n,)."""
        return np.array(self._station.GetOutputPort("encoders").Eval(self.context), dtype=float)

    def advance(self, until: float) -> None:
        """Go on to a time, commanding what is due on the way."""
        due = [
            (at, port, command)
            for port, program in self._programs.items()
            for at, command in program.due(self._now, until)
        ]
        for at, port, command in sorted(due, key=lambda one: one[0]):
            self._simulator.AdvanceTo(at)
            self._station.GetInputPort(port).FixValue(self.context, command)
        self._simulator.AdvanceTo(until)
        self._now = until
