"""Whether a lens bends light as its model says: what residuals have in common over the image.

Noise of corners knows nothing of the image. Where residuals r depend on the radius or the direction
from its centre, a field of displacements g_j explains a part of them that no camera and no board of
the model can: with J the Jacobian of all free variables and M = I - J (J'J)^-1 J',

    E = r'M G (G'M G)^-1 G'M r,    F = (E / k) / ((r'r - E) / (n - k))

which is Fisher's F with k and n - k degrees of freedom if there is no such field (the score test,
Rao 1948). Its fields are hats over the radius, and hats times cos and sin of one to three times the
direction.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration

_RINGS, _SECTOR_RINGS, _WAVES = 8, 4, 3
_CERTAIN = 8.0
"""Standard scores of F: real corners are not quite Gaussian."""
_TOLD, _NOTHING = 1e-6, 1e-12
"""Share of the largest singular value below which a direction is none, and lengths that are 0."""
_HELD = (("k3",), ("p1", "p2"), ("skew",), ("k2",), ("k1",))
"""What may be held, and its cure be to let it move."""


@dataclass(frozen=True)
class LensMisfit:
    """What residuals of one camera have in common over the image."""

    camera: str
    """Which camera."""
    certain: float
    """Standard score of the test; large where there is a misfit."""
    share: float
    """Of the mean squared residual that the misfit makes up, 0 to 1."""
    size_px: float
    """Root mean square displacement [px]."""
    held: tuple[str, ...]
    """Parameters that are held and would explain at least half of it."""
    decentred: float = 0.0
    """Standard score of the test for p1 and p2 alone; 0 where they are not held."""

    @property
    def is_certain(self) -> bool:
        """Whether chance cannot explain it."""
        return self.certain >= _CERTAIN

    @property
    def is_decentred(self) -> bool:
        """Whether chance cannot explain what p1 and p2, held, would explain."""
        return self.decentred >= _CERTAIN


@lru_cache(maxsize=4)
def lens_misfits(
    calibration: CameraCalibration, aspect: float | None = None
) -> tuple[LensMisfit, ...]:
    """Test the lens of each camera; of the last few that were tested it is known.

    Args:
        aspect: The ratio fy / fx that was held, if one was.

    Returns:
        One a camera.
    """
    views, inliers = calibration.views, (~calibration.outliers).astype(float)
    lenses = tuple(camera.lens for camera in calibration.cameras)
    block = BoardResiduals(views, calibration.X_LG, 1.0, aspect, lenses)
    parts = block.evaluate_parts(block.start_of(calibration.cameras, calibration.X_LG))
    residuals, by_shared, by_own = parts

    def beyond_boards(columns: NDArray) -> NDArray:
        return block.reduced_jacobian((residuals, columns, by_own), inliers)

    free = [block.shared_names.index(name) for name in calibration.names]
    known = _basis(beyond_boards(by_shared[:, free]))
    r = _without(known, beyond_boards(residuals[:, None]))[:, 0]

    def explained_by(columns: NDArray) -> tuple[float, int]:
        fields = _of_one_size(_without(known, beyond_boards(columns)))
        values, vectors = np.linalg.eigh(fields.T @ fields)
        told = values > _TOLD**2 * max(float(values[-1]), _NOTHING**2)
        along = vectors[:, told].T @ (fields.T @ r)
        return float(np.sum(along**2 / values[told])), int(told.sum())

    found = []
    for e, camera in enumerate(views.cameras):
        explained, k = explained_by(lens_fields(calibration, e))
        seen = np.zeros((len(views), len(views.cameras), 2, len(views.p_GQ)))
        seen[:, e] = (views.seen[:, e] * inliers[:, None])[:, None]
        total = float(np.sum((r * seen.ravel()) ** 2))
        # Half of what a board's pose takes up belongs to each camera of a pair.
        n = max(int(seen.sum()) - 6 * int(inliers.sum()) // len(views.cameras), 1)
        would: dict[tuple[str, ...], float] = {}
        for names in (tuple(f"{camera}.{name}" for name in group) for group in _HELD):
            rows = [block.shared_names.index(name) for name in names if name in block.shared_names]
            if rows and not set(names) & set(calibration.names):
                would[names] = explained_by(by_shared[:, rows])[0]
        held = next((names for names, one in would.items() if one > 0.5 * explained), ())
        aside = _score(would.get((f"{camera}.p1", f"{camera}.p2"), 0.0), total, n, 2)
        found.append(_misfit(camera, explained, total, n, k, held, aside))
    return tuple(found)


def _score(explained: float, total: float, n: int, k: int) -> float:
    """Return how many standard deviations F is above one, of k columns that explain so much."""
    rest, freedom = max(total - explained, 1e-18), n - k
    if freedom < k or not total or not explained:
        return 0.0
    fisher = (explained / k) / (rest / freedom)
    return float((fisher - 1.0) / np.sqrt(2.0 / k + 2.0 / freedom))


def _misfit(
    camera: str,
    explained: float,
    total: float,
    n: int,
    k: int,
    held: tuple[str, ...],
    aside: float,
) -> LensMisfit:
    rest, freedom = max(total - explained, 1e-18), n - k
    if freedom < k or not total:
        return LensMisfit(camera, 0.0, 0.0, 0.0, ())
    # What chance explains as well, k of n coordinates, is taken off.
    share = max(1.0 - rest / total * n / freedom, 0.0)
    size = float(np.sqrt(share * 2.0 * total / n))
    certain = _score(explained, total, n, k)
    return LensMisfit(camera, certain, float(share), size, held, aside)


def lens_fields(calibration: CameraCalibration, camera: int) -> NDArray:
    """Return displacements of all corners in one camera, zeros in the other. Shape (V, F, 2 C P).

    They are evaluated where the model has the corners: where these were measured, the residuals
    themselves would be among them.
    """
    views = calibration.views
    sides = slice(2 * camera, 2 * camera + 2)
    predicted = np.nan_to_num(views.pixels - calibration.residuals)[:, :, sides]
    out = predicted - 0.5 * (np.array(views.image_sizes[camera]) - 1.0)
    radius = np.linalg.norm(out, axis=2)
    along = out / np.maximum(radius, 1e-9)[..., None]
    across = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    seen = views.seen[:, camera]
    share = radius / max(float(radius[seen].max()), 1e-9)
    fields = [along * hat[..., None] for hat in _hats(share, _RINGS)]
    angle = np.arctan2(out[..., 1], out[..., 0])
    for hat in _hats(share, _SECTOR_RINGS):
        for wave in range(1, _WAVES + 1):
            for turn in (np.cos(wave * angle), np.sin(wave * angle)):
                fields += [along * (hat * turn)[..., None], across * (hat * turn)[..., None]]
    stacked = np.moveaxis(np.stack(fields, axis=1), 3, 2) * seen[:, None, None]
    both = np.zeros((len(views), len(fields), len(views.cameras), 2, len(views.p_GQ)))
    both[:, :, camera] = stacked
    return both.reshape(len(views), len(fields), -1)


def _hats(x: NDArray, count: int) -> list[NDArray]:
    """Return functions of 0 <= x <= 1, each 1 at one knot and 0 at the others; none at 0."""
    return [np.maximum(0.0, 1.0 - np.abs(x * (count - 1) - j)) for j in range(1, count)]


def _basis(columns: NDArray) -> NDArray:
    """Return an orthonormal basis of what columns span. Shape (n, k) -> (n, rank)."""
    u, s, _ = np.linalg.svd(_of_one_size(columns), full_matrices=False)
    return u[:, s > _TOLD * max(float(s[0]), _NOTHING)]


def _of_one_size(columns: NDArray) -> NDArray:
    return columns / np.maximum(np.linalg.norm(columns, axis=0), _NOTHING)


def _without(basis: NDArray, columns: NDArray) -> NDArray:
    return columns - basis @ (basis.T @ columns)
