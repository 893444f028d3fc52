"""Score tests of boards and cameras: whether residuals ask for what the model does not have.

An effect is columns Z, changes of the predictions by its m numbers. With M = I - J (J'J)^-1 J', J
by all that was free (boards' poses, cameras), r the residuals and M Z = (Z_1 ... Z_V) by views,

    H = sum Z_v' Z_v,  g = sum Z_v' r_v,  e = H^-1 g,

and e is what one step of a fit with the effect would find (Rao 1948). Corners of one picture err
alike, those of others do not: how far e may be off by chance is told by leaving out one view after
another (the jackknife: Tukey 1958; of clusters: MacKinnon, Nielsen, Webb 2023, CV3):

    e - e_-v = (H - Z_v' Z_v)^-1 Z_v' (r_v - Z_v e),   S = (V - 1) / V sum (e - e_-v)(e - e_-v)',

and with e' S^-1 e = T^2, (V - m) / ((V - 1) m) T^2 is F with m and V - m degrees of freedom
(Hotelling 1931). A few views may by chance agree too well: what is certain must be so, too, if all
corners err by themselves, F = (g'e / m) / ((r'r - g'e) / (n - m)).
"""

from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.cameras.board_residuals import BoardResiduals
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.lacks.effect_columns import EffectColumns
from nico_selfmodel.optimization.fisher_tail import fisher_tail

_TOLD = 1e-6
"""Part of an effect's square below which the fit has it already."""
_NOTHING = 1e-12
_FEWEST = 3
"""Views before and after a change, at least."""
_SPARE = 2
"""Views, at least, beyond the numbers of an effect."""


@dataclass(frozen=True, eq=False)
class EffectScore:
    """What residuals say of one effect."""

    values: NDArray
    """Its numbers. Shape (m,)."""
    chance: float
    """How often noise alone does so much, at any of the places that were looked at."""
    scores: float
    """Standard deviations that the numbers are off zero, along them."""
    share: float
    """Of the squared residuals that it explains beyond what chance does."""
    squares: float
    """That it explains, in those of one coordinate."""
    off: float
    """Standard deviations, as they are printed, that it puts a number of the cameras off; or all
    together, in the root mean square, where these are further off."""
    worst: str
    """The number that is furthest off."""
    start: int = 0
    """View from which on it is there, or the only one that has it."""


class EffectTest:
    """Residuals and fitted directions at a solution, against which effects are held."""

    def __init__(self, calibration: CameraCalibration, aspect: float | None = None) -> None:
        """Prepare.

        Args:
            aspect: The ratio fy / fx that was held, if one was.
        """
        self.calibration, views = calibration, calibration.views
        self.inliers = np.flatnonzero(~calibration.outliers)
        lenses = tuple(camera.lens for camera in calibration.cameras)
        self._block = BoardResiduals(views, calibration.X_LG, 1.0, aspect, lenses)
        x = self._block.start_of(calibration.cameras, calibration.X_LG)
        self._parts = self._block.evaluate_parts(x)
        self.columns = EffectColumns(calibration, self._block, self._parts)
        free = [self._block.shared_names.index(name) for name in calibration.names]
        self._jacobian = self._beyond_boards(self._parts[1][:, free])
        self._basis = _basis_of(self._jacobian)
        self._r = self._without(-self._beyond_boards(self._parts[0][:, None]))[:, 0]

    @property
    def redundancy(self) -> int:
        """Coordinates that were seen, less the numbers that were fitted."""
        seen = 2 * int(self.calibration.views.seen[self.inliers].sum())
        return max(seen - 6 * len(self.inliers) - self._basis.shape[1], 1)

    def beside(self, columns: NDArray) -> "EffectTest":
        """Return the test had the fit an effect, too. Shape (V, m, k)."""
        found = copy(self)
        more = self._without(self._beyond_boards(columns))
        found._basis = np.hstack([self._basis, _basis_of(more)])
        found._r = found._without(self._r[:, None])[:, 0]
        return found

    def decentring(self) -> list[NDArray]:
        """Return columns by p1 and p2 of each camera in which they are held. Shapes (V, 2, k)."""
        names, free = self._block.shared_names, set(self.calibration.names)
        pairs = [(f"{c}.p1", f"{c}.p2") for c in self.calibration.views.cameras]
        held = [pair for pair in pairs if set(pair) <= set(names) - free]
        return [self._parts[1][:, [names.index(name) for name in pair]] for pair in held]

    def squares_of(self, columns: NDArray) -> float:
        """Return the squares that columns explain, in those of one coordinate. Shape (V, m, k)."""
        basis = _basis_of(self._without(self._beyond_boards(columns)))
        total, explained = float(self._r @ self._r), float(np.sum((basis.T @ self._r) ** 2))
        return explained / max((total - explained) / self.redundancy, _NOTHING)

    def of(self, columns: NDArray, places: int = 1) -> EffectScore | None:
        """Hold an effect against the residuals; None where they cannot tell it.

        Args:
            columns: Change of the predictions by its numbers. Shape (V, m, k).
            places: How many such effects were looked at.
        """
        reduced = self._beyond_boards(columns)
        Z, m, count = self._without(reduced), columns.shape[1], len(self.inliers)
        length = np.linalg.norm(reduced, axis=0)
        if count < m + _SPARE or not _is_told(Z, length):
            return None
        size = np.linalg.norm(Z, axis=0)
        Z = Z / size
        H, g = Z.T @ Z, Z.T @ self._r
        e = np.linalg.solve(H, g)
        by_view, r = Z.reshape(len(columns), -1, m)[self.inliers], self._by_view(self._r)
        own = np.swapaxes(by_view, 1, 2) @ by_view
        left = (np.swapaxes(by_view, 1, 2) @ r[:, :, None])[:, :, 0] - own @ e
        # A view that alone tells an effect leaves nothing without it: that is as good as unknown.
        rest = H - own + _NOTHING * np.eye(m)
        apart = np.linalg.solve(rest, left[:, :, None])[:, :, 0]
        S = (count - 1.0) / count * apart.T @ apart
        T2 = float(e @ np.linalg.lstsq(S, e, rcond=None)[0]) if S.any() else np.inf
        by_views = fisher_tail(min(T2, 1e9) * (count - m) / ((count - 1.0) * m), m, count - m)
        chance = places * max(by_views, self._by_corners(float(g @ e), m))
        return self._score(e / size, chance, np.sqrt(T2), float(g @ e), reduced @ (e / size))

    def of_change(self, columns: NDArray) -> EffectScore | None:
        """Hold an effect that began between two views against the residuals: the best of all."""
        places = np.arange(_FEWEST, len(self.inliers) - _FEWEST + 1)
        if not len(places):
            return None
        A, B, g = self._sums(columns)
        # Of all views from each one on.
        A, B, g = (np.cumsum(one[::-1], axis=0)[::-1][places] for one in (A, B, g))
        explained, _ = _explained(A - np.swapaxes(B, 1, 2) @ B, g, A)
        start = int(self.inliers[places[np.argmax(explained)]])
        later = (np.arange(len(columns)) >= start)[:, None, None]
        found = self.of(columns * later, len(places))
        return None if found is None else replace(found, start=start)

    def of_one_view(self, columns: NDArray) -> EffectScore | None:
        """Hold an effect on one view against what the same explains in the others.

        E_v / mean of the others is F with m and m times their number of degrees of freedom, in
        whatever way corners of one picture err alike.
        """
        A, B, g = self._sums(columns)
        explained, values = _explained(A - np.swapaxes(B, 1, 2) @ B, g, A)
        told, m = np.isfinite(explained), columns.shape[1]
        others = int(told.sum()) - 1
        if others < _FEWEST:
            return None
        most = int(np.nanargmax(explained))
        ratio = explained[most] * others / max(np.nansum(np.delete(explained, most)), _NOTHING)
        chance = max(fisher_tail(ratio, m, m * others), self._by_corners(explained[most], m))
        view, e = int(self.inliers[most]), values[most]
        alone = np.zeros_like(columns)
        alone[view] = columns[view]
        moved = self._beyond_boards(alone) @ e
        squares = float(explained[most])
        found = self._score(e, (others + 1) * chance, np.sqrt(m * ratio), squares, moved)
        return replace(found, start=view)

    def _sums(self, columns: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Return Z'Z, Q'Z and Z'r of each view that counts. Shapes (I, m, m), (I, s, m), (I, m)."""
        Z = self._by_view(self._beyond_boards(columns))
        Q, r = self._by_view(self._basis), self._by_view(self._r)
        transposed = np.swapaxes(Z, 1, 2)
        return transposed @ Z, np.swapaxes(Q, 1, 2) @ Z, (transposed @ r[:, :, None])[:, :, 0]

    def _by_corners(self, squares: float, m: int) -> float:
        """Return how often as much is explained by chance if all corners err by themselves."""
        rest = max(float(self._r @ self._r) - squares, _NOTHING)
        below = max(self.redundancy - m, 1)
        return fisher_tail(squares / m / (rest / below), m, below)

    def _score(
        self, values: NDArray, chance: float, scores: float, squares: float, moved: NDArray
    ) -> EffectScore:
        """Return what was found of an effect that moves pixels, boards placed anew. (n,)."""
        n, m, total = self.redundancy, len(values), max(float(self._r @ self._r), _NOTHING)
        share = 1.0 - (1.0 - squares / total) * n / max(n - m, 1)
        # What a fit without the effect makes of its numbers: (J'J)^-1 J' Z e.
        names, known = self.calibration.names, self.calibration.uncertainty
        size = np.maximum(np.linalg.norm(self._jacobian, axis=0), _NOTHING)
        shift = np.linalg.lstsq(self._jacobian / size, moved, rcond=1e-10)[0] / size
        each = np.abs(shift) / np.maximum(known.sigma, _NOTHING)
        scaled = shift / np.maximum(np.sqrt(np.diag(known.covariance)), _NOTHING)
        along = float(scaled @ np.linalg.lstsq(known.correlation, scaled, rcond=1e-10)[0])
        together = np.sqrt(max(along, 0.0) / len(names))
        off = float(max(each.max(initial=0.0), together))
        worst = names[int(np.argmax(each))]
        noise = max((total - squares) / n, _NOTHING)
        return EffectScore(
            values, min(chance, 1.0), float(scores), float(share), squares / noise, off, worst
        )

    def _beyond_boards(self, columns: NDArray) -> NDArray:
        """Return columns with what boards' poses can do taken off. Shape (V, m, k) -> (n, m)."""
        weight = np.zeros(len(columns))
        weight[self.inliers] = 1.0
        return self._block.reduced_jacobian((self._parts[0], columns, self._parts[2]), weight)

    def _without(self, columns: NDArray) -> NDArray:
        return columns - self._basis @ (self._basis.T @ columns)

    def _by_view(self, rows: NDArray) -> NDArray:
        """Return rows of the views that count, by views. Shape (n, ...) -> (I, k, ...)."""
        return rows.reshape(len(self.calibration.views), -1, *rows.shape[1:])[self.inliers]


def _is_told(columns: NDArray, length: NDArray) -> bool:
    """Tell whether the fit leaves something of each combination of columns. Shape (n, m)."""
    unit = columns / np.maximum(length, _NOTHING)
    return bool((length > _NOTHING).all() and np.linalg.eigvalsh(unit.T @ unit)[0] > _TOLD)


def _explained(H: NDArray, g: NDArray, whole: NDArray) -> tuple[NDArray, NDArray]:
    """Return g'H^-1 g and H^-1 g of several effects; nan where the fit has all of one already.

    Args:
        H: Z'MZ. Shape (N, m, m).
        g: Z'r. Shape (N, m).
        whole: Z'Z. Shape (N, m, m).

    Returns:
        Shapes (N,) and (N, m).
    """
    size = np.sqrt(np.maximum(np.einsum("nii->ni", whole), _NOTHING))
    values, vectors = np.linalg.eigh(H / (size[:, :, None] * size[:, None]))
    told = values[:, 0] > _TOLD
    along = np.einsum("nij,ni->nj", vectors, g / size)
    e = np.einsum("nij,nj->ni", vectors, along / np.where(told[:, None], values, 1.0)) / size
    return np.where(told, np.sum(g * e, axis=1), np.nan), e


def _basis_of(columns: NDArray) -> NDArray:
    """Return an orthonormal basis of what columns span. Shape (n, k) -> (n, rank)."""
    unit = columns / np.maximum(np.linalg.norm(columns, axis=0), _NOTHING)
    u, s, _ = np.linalg.svd(unit, full_matrices=False)
    return u[:, s > _TOLD * max(float(s[0]), _NOTHING)]
