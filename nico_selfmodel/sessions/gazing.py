"""A body that turns its head to a point and looks again until it sees it in the middle."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import RobotError
from nico_selfmodel.plant.looking.again import SeenOff
from nico_selfmodel.plant.looking.gaze import WITHIN_PX, Gaze, GazeSolver
from nico_selfmodel.recording.session import Body
from nico_selfmodel.systems.measurements import CameraMeasurement


@dataclass(frozen=True, eq=False)
class Looked:
    """What came of turning to a point."""

    gaze: Gaze
    """The last turn, and where the cameras were expected to see the point after it."""
    pixels: Mapping[str, NDArray]
    """Where each saw it, nan where it did not [px]. Shape (2,) each."""
    off_px: float
    """Largest distance from the middle of an image; nan where one saw nothing [px]."""
    misaligned_px: float
    """What of it is that the cameras look past each other, see `Gaze` [px]."""
    looks: int
    """How many turns it took."""

    @property
    def in_middle(self) -> bool:
        """Whether all cameras see it, and their mean is within 10 px of the images' middle."""
        return bool(self.off_px - self.misaligned_px <= WITHIN_PX)


def look_at(
    body: Body,
    solver: GazeSolver,
    readings: ArrayLike,
    marker: str,
    p_WT: ArrayLike | None = None,
    *,
    looks: int = 8,
) -> Looked:
    """Turn a head to a marker, and look again until it is in the middle of the images.

    Where each look sees the marker tells how far it is from where the body expects it, see
    `SeenOff`. A marker that a look does not see ends it: nothing tells where it is.

    Args:
        body: What moves and sees; its joints and cameras are the learned body's, in its order.
        readings: Of all joints now [encoder units]. Shape (n,).
        marker: What the cameras look for.
        p_WT: Where it is, in the body's world [m]; a marker of the body itself if omitted. (3,).
        looks: How often to turn, at most.

    Raises:
        ModelError: If it is out of reach.
        RobotError: If the body has no cameras that look for this marker.
        ValueError: If there is no such marker, no look is wanted, or a number is not finite.
    """
    if looks < 1:
        raise ValueError(f"looks must be at least 1, got {looks}")
    place = partial(_expected, solver, marker, p_WT)
    now, off, turn = np.asarray(readings, dtype=float), SeenOff(), 0
    while True:
        gaze, turn = solver.at_point(now, place(now) + off.offset), turn + 1
        now, told = _measured(body, solver, gaze, marker)
        found = Looked(gaze, told, *solver.off_middle(told), turn)
        if found.in_middle or turn == looks or not np.isfinite(list(told.values())).any():
            return found
        off = solver.again(now, place(now), told, off)


def _expected(
    solver: GazeSolver, marker: str, p_WT: ArrayLike | None, readings: NDArray
) -> NDArray:
    """Return where a marker is, as far as is known."""
    if p_WT is None:
        return solver.place_of(readings, marker)
    return np.asarray(p_WT, dtype=float)


def _measured(
    body: Body, solver: GazeSolver, gaze: Gaze, marker: str
) -> tuple[NDArray, dict[str, NDArray]]:
    """Turn there; return the readings, and where each camera that looks sees the marker."""
    seen = body.move_and_measure(gaze.readings)
    if not isinstance(seen, CameraMeasurement) or marker not in seen.pixels:
        raise RobotError(f"nothing looks for {marker!r}: give a body whose cameras track it")
    pixels = np.asarray(seen.pixels[marker], dtype=float).reshape(-1, 2)
    names = list(solver.model.tree.lenses)
    if len(pixels) != len(names):
        raise RobotError(f"the body has {len(pixels)} cameras, its model has {len(names)}")
    both = dict(zip(names, pixels, strict=True))
    return seen.encoders, {name: both[name] for name in gaze.pixels}
