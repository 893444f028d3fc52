"""What a make of motors has to do to be driven: the bus of an arm, and each motor on it.

`ArmController` stands on nothing else, so that goals, heartbeat, stops and jams are the same for
every make. Positions are the motor's own numbers (registers), speeds are counts a second.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol, Self

from nico_selfmodel.servos.arm.servo_config import ServoConfig
from nico_selfmodel.servos.bus_settings import BusSettings
from nico_selfmodel.servos.found_motor import Scan
from nico_selfmodel.servos.link_counts import LinkCounts
from nico_selfmodel.servos.ports import Port


@dataclass(frozen=True)
class Reading:
    """What a motor said of itself at one moment."""

    position: int
    """Where the joint is [register]."""
    commanded: int
    """Where the motor's own profile wants it to be [register]."""
    standing: bool
    """Whether the motor has nothing more to do."""
    fault: str | None = None
    """What is wrong with it, if it is meant to hold; None where nothing is."""


class Motor(Protocol):
    """One motor at its address. Every method raises `BusError` where it does not answer."""

    @property
    def counts(self) -> LinkCounts:
        """How well the wire to it works."""
        ...

    @property
    def answers(self) -> bool:
        """Whether what `move_to` and `brake` return was read after they were carried out."""
        ...

    @property
    def doubtful(self) -> bool:
        """Whether a reading counts only if a second one agrees: a bad line, a weak checksum."""
        ...

    def halt(self) -> None:
        """Begin to stop it where an earlier program left it moving; waits for nothing."""
        ...

    def take_over(self) -> bool:
        """Stop it where an earlier program left it moving, and set it up where it holds.

        It is switched on by nothing, and off only where it is driven without its servo.

        Returns:
            Whether it holds its joint, without a fault.
        """
        ...

    def switch_on(self) -> None:
        """Let it hold where it stands; faults are cleared, earlier goals forgotten."""
        ...

    def poll(self) -> Reading:
        """Return what it says now."""
        ...

    def look_again(self, reading: Reading) -> Reading:
        """Return what it says now, to be compared with a reading that is doubted."""
        ...

    def move_to(
        self, goal: int, velocity: float | None, acceleration: float | None, *, start: bool
    ) -> Reading:
        """Give it a goal, to go there now or at the next `JointBus.flush`.

        Args:
            goal: [register].
            velocity: [counts/s]; the last one if None.
            acceleration: [counts/s^2]; the last one if None.
            start: Whether to go at once.
        """
        ...

    def brake(self, acceleration: float, *, start: bool) -> Reading:
        """Slow it down to a standstill [counts/s^2], now or at the next `JointBus.flush`."""
        ...

    def stop(self, *, smoothly: bool) -> None:
        """Stop and hold; returns when it confirmed."""
        ...

    def release(self) -> None:
        """Switch it off: a loaded joint falls."""
        ...

    def knows_its_zero(self) -> bool:
        """Return whether its register counts from the zero of the configuration."""
        ...

    def zero_at(self, register: int) -> None:
        """Make where it stands `register`."""
        ...


class JointBus(Protocol):
    """The motors of one configuration on their port. Making one sends nothing."""

    @classmethod
    def open(cls, port: str, config: ServoConfig, settings: BusSettings) -> Self:
        """Open a port; sends nothing."""
        ...

    @classmethod
    def scan(cls, port: str, baud: int | None, last: int) -> Scan:
        """Find the motors on a port, whatever their configuration; moves and resets nothing."""
        ...

    @staticmethod
    def simulated_line() -> Callable[..., Any]:
        """Return the class of their simulated line: `(motors or how many, faults, plant)`."""
        ...

    @property
    def port(self) -> Port:
        """The port, whose time is the arm's."""
        ...

    @property
    def motors(self) -> Sequence[Motor]:
        """In the order of the configuration's joints."""
        ...

    def find(self) -> None:
        """Find every motor; moves nothing, and resets nothing that has a zero.

        Raises:
            BusError: If one is missing or not what it should be; says which and what to do.
        """
        ...

    def read_all(self) -> None:
        """Read every motor in one go, where the make can: each `poll` that follows is free."""
        ...

    def flush(self) -> None:
        """Start together what was loaded, send together what waits."""
        ...

    def stop_all(self, motors: Sequence[Motor], *, smoothly: bool) -> None:
        """Stop motors at once and have them hold; nobody confirms.

        Where the make allows it without waiting for what arrives: the line may be noisy or dead.
        """
        ...

    def release_all(self, motors: Sequence[Motor]) -> None:
        """Switch motors off at once, without waiting for what arrives; nobody confirms."""
        ...

    def hurried(self) -> AbstractContextManager[None]:
        """Ask every motor but once within a `with` block, as somebody waits for a stop."""
        ...

    def close(self) -> None:
        """Give the port back; never fails."""
        ...
