"""Mirrors held against reflections: predicted pixels, and points rebuilt from their reflections."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mirror_initialization import virtual_points
from nico_selfmodel.estimation.mirrors.mirror_solution import MirrorSolution, solve_mirrors
from nico_selfmodel.estimation.mirrors.reflection_residuals import project_reflections, values_of
from nico_selfmodel.estimation.mirrors.reflections import Reflections
from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.estimation.results.folds import Fold, cross_validate, fold_of
from nico_selfmodel.model.cameras.mirror import Mirror


@dataclass(frozen=True, eq=False)
class MirrorEvaluation:
    """Mirrors held against reflections."""

    reflections: Reflections
    """What was seen."""
    residuals: NDArray
    """Measured minus predicted pixels; nan where not seen [px]. Shape (N, 2 C)."""
    p_LQ_rebuilt: NDArray
    """Points rebuilt from both cameras' pixels in the mirror, in the first camera's frame; nan
    where one camera did not see it [m]. Shape (N, 3)."""

    @classmethod
    def from_reflections(
        cls, reflections: Reflections, mirrors: tuple[Mirror, ...]
    ) -> "MirrorEvaluation":
        """Predict and rebuild.

        Args:
            mirrors: In the order of `reflections.mirrors`.
        """
        shown = project_reflections(reflections, values_of(mirrors)).pixels
        virtual, rebuilt = virtual_points(reflections), np.full((len(reflections), 3), np.nan)
        for m, mirror in enumerate(mirrors):
            rows = reflections.mirror == m
            rebuilt[rows] = mirror.reflect(virtual[rows])
        return cls(reflections, reflections.pixels - shown, rebuilt)

    @property
    def distances_px(self) -> NDArray:
        """Reprojection error of each row in each camera that saw it [px]. Shape (K,)."""
        distances = np.linalg.norm(self.residuals.reshape(len(self.residuals), -1, 2), axis=2)
        return distances[np.isfinite(distances)]

    @property
    def by_pose_px(self) -> NDArray:
        """Mean reprojection error of each pose over its rows and cameras [px]. Shape (poses,)."""
        distances = np.linalg.norm(self.residuals.reshape(len(self.residuals), -1, 2), axis=2)
        _, pose = np.unique(self.reflections.pose, return_inverse=True)
        seen = np.isfinite(distances)
        total = np.bincount(pose, np.where(seen, distances, 0.0).sum(axis=1))
        return total / np.bincount(pose, seen.sum(axis=1))

    @property
    def distances(self) -> NDArray:
        """Distance of rebuilt points from where the body expects them [m]. Shape (K,)."""
        found = np.linalg.norm(self.p_LQ_rebuilt - self.reflections.p_LQ, axis=1)
        return found[np.isfinite(found)]

    @property
    def pixel_statistics(self) -> ErrorStatistics:
        """Summary of `distances_px`, in pixels."""
        return ErrorStatistics.from_distances(self.distances_px)

    def select(self, rows: NDArray) -> "MirrorEvaluation":
        """Return the chosen rows. `rows` is a boolean mask or an index."""
        return replace(
            self,
            reflections=self.reflections.select(rows),
            residuals=self.residuals[rows],
            p_LQ_rebuilt=self.p_LQ_rebuilt[rows],
        )


def cross_validate_mirrors(solution: MirrorSolution) -> MirrorEvaluation | None:
    """Predict each fifth of the poses from planes learned on the rest, outliers left out.

    Returns:
        The inliers, each predicted without its fold; None where a mirror has one pose alone.
    """
    kept = solution.reflections.select(~solution.outliers)
    fold = _folds(kept)
    if fold is None:
        return None

    def learn(part: Fold) -> tuple[Mirror, ...]:
        return solve_mirrors(
            kept.select(part.rest), solution.mirrors, solution.noise, "none"
        ).mirrors

    def predict(mirrors: tuple[Mirror, ...], part: Fold) -> NDArray:
        found = MirrorEvaluation.from_reflections(kept.select(part.left), mirrors)
        return np.column_stack([found.residuals, found.p_LQ_rebuilt])

    found = cross_validate(fold, learn, predict)
    return MirrorEvaluation(kept, found[:, :-3], found[:, -3:])


def _folds(reflections: Reflections) -> NDArray | None:
    """Number the folds of poses so that each leaves every mirror some; None if that cannot be."""
    fold = np.zeros(len(reflections), dtype=int)
    for m in range(len(reflections.mirrors)):
        rows = reflections.mirror == m
        fold[rows] = fold_of(reflections.pose[rows])
        if not fold[rows].any():
            return None
    return fold
