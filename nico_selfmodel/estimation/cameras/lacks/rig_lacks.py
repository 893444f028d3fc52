"""What boards and cameras did that no calibration has: a bent board, a camera that was moved.

Each is held against the residuals by `EffectTest`. The one that explains most is taken, and all are
held against what it leaves, until none is certain and notable any more: a board of another shape
also looks a little like another lens, and like a camera that moved. Where a lens bends light as its
model does not, its fields stand among them, and p1 and p2 where they are held, so that nothing else
is blamed for these.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.lacks.effect_columns import EffectColumns
from nico_selfmodel.estimation.cameras.lacks.effect_test import EffectScore, EffectTest

STRETCH, SKEW, BEND, MOVED, ZOOMED, ASIDE = "stretch", "skew", "bend", "moved", "zoomed", "aside"
CHANCE, SURE = 1e-3, 1e-4
"""How often chance may do so much, at any place that was looked at, to be mentioned, and to fail:
of sound sets, each held against up to nine effects, one in a thousand is failed at most."""
NOTABLE, LARGE = 3.0, 5.0
"""Printed standard deviations that cameras are put off by it, from which on it is mentioned, and
fails: within three of them a number may be off by chance, and a real board that is 0.7 mm out of
its plane, with some corners found pixels off, puts cameras off by four."""
SHARE = 0.01
"""Share of the squared residuals that it must explain: of less no picture shows anything."""
_MOST = 3
"""How many are told."""


@dataclass(frozen=True)
class Lack:
    """What a board or a camera did that the model does not have."""

    kind: str
    """`STRETCH`, `SKEW`, `BEND`, `MOVED`, `ZOOMED` or `ASIDE`."""
    amount: float
    """Share, angle [rad], way out of the plane or shift [m] of it."""
    sigma: float
    """Of the amount."""
    off: float
    """Printed standard deviations that the cameras are put off by it."""
    worst: str
    """The number of the cameras that is put off furthest."""
    share: float
    """Of the squared residuals that it explains."""
    chance: float
    """How often chance alone does so much."""
    camera: str = ""
    """Which camera, where it is one."""
    view: str = ""
    """From which view on, or in which alone."""
    turn: float = 0.0
    """By which a camera was turned [rad]."""

    @property
    def fails(self) -> bool:
        """Whether cameras are further off than their sigmas can mean, for sure."""
        return self.off >= LARGE and self.chance <= SURE

    @property
    def bends_images(self) -> bool:
        """Whether it looks as if a lens bent light in another way."""
        return self.kind in (STRETCH, SKEW, BEND, ZOOMED)


def lacks_of(
    calibration: CameraCalibration,
    aspect: float | None = None,
    lens_fields: tuple[NDArray, ...] = (),
) -> tuple[Lack, ...]:
    """Return what boards and cameras did that the model does not have, the largest first.

    Args:
        aspect: The ratio fy / fx that was held, if one was.
        lens_fields: Displacements that lenses ask for, of each that does. Shapes (V, F, k).
    """
    if not calibration.residuals.size or not np.nanmax(np.abs(calibration.residuals)) > 0.0:
        return ()
    test, found = EffectTest(calibration, aspect), []
    fields = [*test.decentring(), *lens_fields]
    while len(found) < _MOST:
        told = [c for c in _candidates(test) if is_told(c[2])]
        if not told:
            break
        kind, camera, score, columns = max(told, key=lambda c: c[2].squares)
        lenses = [test.squares_of(field) for field in fields]
        if lenses and max(lenses) > score.squares:
            test = test.beside(fields.pop(int(np.argmax(lenses))))
            continue
        found.append(_lack(test, kind, camera, score))
        test = test.beside(columns)
    return tuple(found)


def is_told(score: EffectScore) -> bool:
    """Tell whether an effect is certain, and worth a word."""
    return score.chance <= CHANCE and score.off >= NOTABLE and score.share >= SHARE


_Candidate = tuple[str, int, EffectScore, NDArray]
"""Kind, camera, what residuals say, and columns. Shape (V, m, k)."""


def _candidates(test: EffectTest) -> Iterator[_Candidate]:
    """Yield all that may be, as far as residuals can tell it."""
    columns = test.columns
    shapes = ((STRETCH, columns.stretch()), (SKEW, columns.skew()), (BEND, columns.bend()))
    for kind, one in shapes:
        yield from _scored(kind, 0, test.of(one), one)
    cameras = len(test.calibration.cameras)
    views = np.arange(len(test.calibration.views))
    for camera in range(cameras):
        zoom = columns.camera_zoomed(camera)
        found = test.of_change(zoom)
        yield from _scored(ZOOMED, camera, found, zoom * _from(views, found))
        if cameras == 1 or (cameras == 2 and camera == 0):
            continue  # which of two moved, nobody can tell
        moved = columns.camera_moved(camera)
        found = test.of_change(moved)
        yield from _scored(MOVED, camera, found, moved * _from(views, found))
        found = test.of_one_view(moved)
        alone = views == (-1 if found is None else found.start)
        yield from _scored(ASIDE, camera, found, moved * alone[:, None, None])


def _from(views: NDArray, found: EffectScore | None) -> NDArray:
    start = len(views) if found is None else found.start
    return (views >= start)[:, None, None]


def _scored(
    kind: str, camera: int, score: EffectScore | None, columns: NDArray
) -> Iterator[_Candidate]:
    if score is not None:
        yield kind, camera, score, columns


def _lack(test: EffectTest, kind: str, camera: int, score: EffectScore) -> Lack:
    """Return what was found, in units that people measure."""
    calibration, e, turn = test.calibration, score.values, 0.0
    amount = float(e[0])
    if kind == BEND:
        amount = _out_of_plane(test.columns, e)
    if kind in (MOVED, ASIDE):
        turn, amount = (float(np.linalg.norm(part)) for part in (e[:3], e[3:]))
    if kind == ASIDE:
        amount = test.columns.board_shift(camera, score.start, e)
    of_camera = kind in (MOVED, ASIDE, ZOOMED)
    return Lack(
        kind,
        amount,
        abs(amount) / max(score.scores, 1e-12),
        score.off,
        score.worst,
        score.share,
        score.chance,
        calibration.views.cameras[camera] if of_camera else "",
        calibration.views.names[score.start] if of_camera else "",
        turn,
    )


def _out_of_plane(columns: EffectColumns, e: NDArray) -> float:
    """Return how far the corners of a bent board lie apart across the plane through them [m]."""
    z = e @ columns.bends()
    plane = np.column_stack([np.ones(len(z)), columns.on_board[:, :2]])
    return float(np.ptp(z - plane @ np.linalg.lstsq(plane, z, rcond=None)[0]))
