"""A bus of simulated motors, of any make, behind a pseudo-terminal."""

import time
from collections.abc import Sequence
from typing import Any

from nico_selfmodel.servos.drivers import simulated_line
from nico_selfmodel.servos.simulated.line import Plant, SimulatedLine
from nico_selfmodel.servos.simulated.pseudo_terminal import PseudoTerminal


class SimulatedBus(PseudoTerminal[SimulatedLine]):
    """Simulated motors on a pseudo-terminal, for any program that opens it.

    What a real bus does and this one does not: bits are never lost to a wrong level, a profile's
    last unit differs from the chip's, and the polarity of the limit inputs is a guess.
    """

    def __init__(
        self,
        modules: int | Sequence[Any] = 6,
        *,
        make: str = "pic-servo",
        plant: Plant | None = None,
        latency: float = 1e-3,
    ) -> None:
        """Describe a bus; nothing runs before it is entered.

        Args:
            modules: How many, or which (of this make), in their order on the line.
            make: Of the motors: `pic-servo`, `dynamixel` or `feetech`.
            plant: What moves the shafts behind the servos.
            latency: How long the adapter holds on to bytes that arrive [s].
        """
        super().__init__(simulated_line(make)(modules, None, plant), latency)

    @property
    def line(self) -> SimulatedLine:
        """The line; hold `lock` while changing it."""
        return self.device

    @property
    def modules(self) -> list[Any]:
        """The motors in their order on the line; hold `lock` while changing one."""
        return self.device.modules

    def shafts(self) -> list[float]:
        """Return where the shafts stand now [counts], whoever is connected."""
        with self.lock:
            self.device.advance(time.monotonic())
            return [module.shaft for module in self.device.modules]
