"""What a driver of motors does, whatever their make: write one of these to drive others.

`ArmLoop`, `MotorServer` and all that stands on them use nothing else of a driver. The one there is
drives PIC-SERVO boards: `ArmController`.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.servos.arm_state import ArmState


class MotionLimits(Protocol):
    """What may be commanded."""

    @property
    def positions(self) -> NDArray:
        """Lowest and highest joint displacement [rad]. Shape (n, 2)."""
        ...

    @property
    def speeds(self) -> NDArray:
        """Largest joint speeds [rad/s]. Shape (n,)."""
        ...

    def registers(self, q: NDArray, joints: Sequence[int]) -> Sequence[int]:
        """Return the motors' own numbers at displacements of the joints meant, or refuse them.

        Raises:
            ValueError: If one is not finite or beyond its limits.
        """
        ...


class MotorDriver(Protocol):
    """Drives joints by name in radians, from one thread at a time.

    Nothing waits for a motion: `move` and `command` set goals, and each `cycle` reads every joint
    and moves the goals on. Without cycles, or `longest_silence` after the last `heartbeat`, the arm
    stops, whatever became of this process.
    """

    @property
    def name(self) -> str:
        """What the arm is called."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Names in order. Length n."""
        ...

    @property
    def limits(self) -> MotionLimits:
        """What may be commanded."""
        ...

    @property
    def longest_silence(self) -> float:
        """Time between two heartbeats after which the arm stops [s]."""
        ...

    def now(self) -> float:
        """Return the time that states are stamped with [s]."""
        ...

    def connect(self) -> tuple[str, ...]:
        """Find the motors; moves nothing. Returns the joints whose zero is not known."""
        ...

    def enable(self, joints: Sequence[str] | None = None) -> None:
        """Let joints hold where they stand, all if omitted."""
        ...

    def move(self, targets: Mapping[str, float], *, speed: float | None = None) -> float:
        """Send joints to displacements [rad] so that they arrive together; returns when [s]."""
        ...

    def command(
        self, q: ArrayLike, *, speed: float | None = None, joints: Sequence[int] | None = None
    ) -> None:
        """Set where joints are to go [rad]; the next `cycle` sends it. Shape (n,)."""
        ...

    def heartbeat(self) -> None:
        """Say that the host is alive."""
        ...

    def cycle(self) -> ArmState:
        """Read every joint once and move the goals on."""
        ...

    def state(self) -> ArmState:
        """Return what is known now; sends nothing."""
        ...

    def stop(self) -> None:
        """Stop every joint and hold."""
        ...

    def release(self, joints: Sequence[str] | None = None) -> None:
        """Switch motors off, all if omitted: what gravity pulls falls."""
        ...

    def close(self) -> None:
        """Stop what moves and give the port back; never fails."""
        ...
