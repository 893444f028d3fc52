"""A simulated servo: its registers, its motion, and what can befall it."""

import math
from itertools import count

from nico_selfmodel.servos.profile import Motion, TimedProfile
from nico_selfmodel.servos.simulated.mechanics import SimulatedMechanics

_SERIALS = count()


class RefusedError(Exception):
    """A packet that the servo answers with an error."""

    def __init__(self, code: int) -> None:
        """Carry the error of the status packet."""
        super().__init__(code)
        self.code = code


class SimulatedServo:
    """A servo with an absolute encoder. Time is whatever the line says."""

    size: int
    """Bytes of its table."""
    torque_register: int

    def __init__(self, address: int, *, shaft: float = 2048.0, baud: int = 1_000_000) -> None:
        """Power a servo up.

        Args:
            address: Its id.
            shaft: Where it stands [counts].
            baud: At which it listens.
        """
        self.address, self.baud = address, baud
        self.mechanics = SimulatedMechanics()
        self.shaft = shaft
        self.silent = False
        """Hears and obeys, but its replies are lost."""
        self.late_by = 0.0
        """Delay of the next reply [s], once."""
        self.external = False
        """Whether a plant outside moves the shaft."""
        self.offset = 0
        """What its homing offset adds to the encoder [counts]."""
        self.faults = 0
        """What it says ails it, in the bits of its make."""
        self.serial = next(_SERIALS)
        """No two servos say quite the same of themselves."""
        self.time = self.heard = 0.0
        """Its clock, and when it heard a packet that was meant for it [s]."""
        self.deaf_until = -math.inf
        """Until when it starts and hears nothing [s]."""
        self.table = bytearray(self.size)
        self.profile = TimedProfile(0.0)
        self.power_cycle()

    def power_cycle(self) -> None:
        """Come up anew: off, without faults; what outlasts the power stays."""
        self.profile = TimedProfile(self.time)
        self.faults = 0

    @property
    def position(self) -> int:
        """What its position register holds [counts]."""
        return round(self.shaft) + self.offset

    @property
    def servo_on(self) -> bool:
        """Whether it holds its shaft."""
        return self.profile.motion != Motion.OFF

    @property
    def commanded_shaft(self) -> float | None:
        """Where it wants the shaft [counts], None where it does not hold it."""
        return float(self.profile.counts - self.offset) if self.servo_on else None

    def advance(self, time: float) -> None:
        """Let its motion go on up to a time [s]."""
        self.time = time
        self.watch()
        self.profile.advance(time)
        if self.servo_on and not self.external and not self.mechanics.stuck:
            self.shaft = float(self.profile.counts - self.offset)

    def watch(self) -> None:
        """Look whether its host is alive, where the make can."""

    def overload(self) -> None:
        """Hit the load limit: it switches itself off."""
        self.faults |= 0x20
        self.switch(on=False)

    def switch(self, *, on: bool) -> None:
        """Hold the shaft, or let go."""
        self.table[self.torque_register] = on
        if not on:
            self.profile.switch_off()
        elif not self.servo_on:
            self.profile.place(self.position)
            self.profile.hold()

    def read(self, register: int, length: int) -> bytes:
        """Return registers.

        Raises:
            RefusedError: If there are none.
        """
        if register + length > self.size:
            raise RefusedError(4)
        self.refresh()
        return bytes(self.table[register : register + length])

    def write(self, register: int, data: bytes) -> None:
        """Write registers, and do what that says.

        Raises:
            RefusedError: If they may not be written.
        """
        raise NotImplementedError

    def refresh(self) -> None:
        """Bring the registers up to date that say how things are."""
        raise NotImplementedError
