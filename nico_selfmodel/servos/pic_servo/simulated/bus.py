"""A bus of simulated modules behind a pseudo-terminal."""

import time
from collections.abc import Sequence

from nico_selfmodel.servos.pic_servo.simulated.line import Plant, SimulatedLine, WireFaults
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule
from nico_selfmodel.servos.pseudo_terminal import PseudoTerminal


class SimulatedBus(PseudoTerminal[SimulatedLine]):
    """Simulated modules on a pseudo-terminal, for any program that opens it.

    What a real bus does and this one does not: bits are never lost to a wrong level, a profile's
    last unit differs from the chip's, and the polarity of the limit inputs is a guess.
    """

    def __init__(
        self,
        modules: int | Sequence[SimulatedModule] = 6,
        *,
        faults: WireFaults | None = None,
        plant: Plant | None = None,
        latency: float = 1e-3,
    ) -> None:
        """Describe a bus; nothing runs before it is entered.

        Args:
            modules: How many, or which, in the order of the chain.
            faults: Damage on the wire; none if omitted.
            plant: What moves the shafts behind the servos.
            latency: How long the adapter holds on to bytes that arrive [s].
        """
        if isinstance(modules, int):
            modules = [SimulatedModule() for _ in range(modules)]
        super().__init__(SimulatedLine(modules, faults, plant), latency)

    @property
    def line(self) -> SimulatedLine:
        """The line; hold `lock` while changing it."""
        return self.device

    @property
    def modules(self) -> list[SimulatedModule]:
        """The modules in the order of their chain; hold `lock` while changing one."""
        return self.device.modules

    def shafts(self) -> list[float]:
        """Return where the shafts stand now [counts], whoever is connected."""
        with self.lock:
            self.device.advance(time.monotonic())
            return [module.shaft for module in self.device.modules]
