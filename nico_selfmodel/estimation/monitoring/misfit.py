"""Whether poses are off by more than noise, all together, be it by no change that is looked for.

With W the noise of whole poses whitened, r what they are off by, and the model wrong alike in all
of them by a draw of its covariance C = L L', U = W J L,

    M = r' (S + J C J')^-1 r = |W r|^2 - (U' W r)' (I + U' U)^-1 (U' W r)

has the mean n, of n coordinates, whatever of it is the model's. A model that hardly knows something
is wrong by more than slopes tell: then the sum pose by pose, r' (S + J C J')^-1 r of each, is less,
and counts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.mixture_density import MixtureDensity
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.optimization.uncertainty import root_of

LOUDER = 1.5
"""Times what was learned that noise may have become."""
_SPREAD = np.sqrt(6.0)
"""Standard deviation of a coordinate's square: a normal's is root 2, that of a tail more."""
_FITS = 4.0
"""Standard deviations of the sum beyond which it is no accident."""


@dataclass(frozen=True)
class Misfit:
    """What poses are off by together, in their noise."""

    squares: float
    """M, or the sum pose by pose where that is less."""
    n: int
    """Coordinates."""

    @classmethod
    def of(cls, poses: PoseResiduals, noise: NoiseMixture, covariance: NDArray) -> "Misfit":
        """Hold poses against a body.

        Args:
            noise: Of them.
            covariance: Of the poses' parameters. Shape (P, P).
        """
        n = int(poses.dof.sum())
        if not n:
            return cls(0.0, 0)
        density = MixtureDensity(poses, noise)
        white = density.in_noise(poses.residuals[:, :, None])[..., 0].ravel()
        U = density.in_noise(poses.slopes @ root_of(covariance)).reshape(len(white), -1)
        along = U.T @ white
        alike = float(along @ np.linalg.solve(np.eye(U.shape[1]) + U.T @ U, along))
        by_pose = float(MixtureDensity(poses, noise, covariance).nis(poses.residuals).sum())
        return cls(max(min(float(white @ white) - alike, by_pose), 0.0), n)

    @property
    def per_coordinate(self) -> float:
        """About 1 where nothing but noise is there."""
        return self.squares / max(self.n, 1)

    @property
    def most(self) -> float:
        """What `per_coordinate` is at most with noise that is `LOUDER`."""
        return LOUDER**2 * (1.0 + _FITS * float(_SPREAD) / np.sqrt(max(self.n, 1)))

    @property
    def too_large(self) -> bool:
        """Whether louder noise does not explain it."""
        return self.per_coordinate > self.most

    @property
    def words(self) -> str:
        """What was found, for a verdict."""
        return (
            f"what was seen is {np.sqrt(self.per_coordinate):.2g} times as far off as noise and "
            f"what the body is known to let expect ({np.sqrt(self.most):.2g} times at most, with "
            "noise that is louder)"
        )
