"""How likely poses are under a mixture of core and tail, as they are and had the body changed."""

from math import lgamma

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_noise import HandNoise, whitening_of
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.model.noise_mixture import NoiseMixture


def core_and_tail(noise: NoiseMixture) -> tuple[HandNoise, HandNoise]:
    """Return the two components of a mixture."""
    return (
        HandNoise(noise.sensor_sigma, noise.joint_sigma),
        HandNoise(noise.tail_sensor_sigma, noise.tail_joint_sigma),
    )


class MixtureDensity:
    """ln f(r) of the residuals of N poses; constants that all share are left out.

    With the covariance C of the model, each component has M = J C J' added: what the model is
    uncertain by.
    """

    def __init__(
        self, poses: PoseResiduals, noise: NoiseMixture, covariance: NDArray | None = None
    ) -> None:
        """Take poses and their noise.

        Args:
            poses: N poses.
            noise: Core and tail.
            covariance: Of the poses' parameters; None where they are taken as known. Shape (P, P).
        """
        extra = poses.by_side @ np.swapaxes(poses.by_side, 1, 2)
        if covariance is not None:
            extra = extra + poses.slopes @ covariance @ np.swapaxes(poses.slopes, 1, 2)
        whole = [part.covariance(poses.by_angle) + extra for part in core_and_tail(noise)]
        self.whitening = np.stack([whitening_of(s, poses.seen) for s in whole])
        """W_k with W_k S_k W_k' = I. Shape (2, N, K, K)."""
        self.outlier_share = noise.outlier_share
        e = noise.tail_share
        self._log_share = np.log([1.0 - e, max(e, np.finfo(float).tiny)])
        # A coordinate that was not measured has a row of zeros in W, and adds nothing.
        unseen = np.eye(poses.seen.shape[1]) * ~poses.seen[:, None]
        self._log_scale = np.linalg.slogdet(self.whitening + unseen)[1]
        self._seen, self._dof = poses.seen, poses.dof
        self.total = (1.0 - e) * whole[0] + e * whole[1]
        """Second moment of a residual. Shape (N, K, K)."""

    def whiten(self, residuals: NDArray) -> NDArray:
        """Return residuals, shape (N, K), or columns, shape (N, K, m), whitened. (2, N, K[, m])."""
        columns = residuals if residuals.ndim == 3 else residuals[:, :, None]
        white = self.whitening @ columns
        return white if residuals.ndim == 3 else white[..., 0]

    def log_parts(self, residuals: NDArray) -> NDArray:
        """Return ln of each component's share of the density. Shape (N, K) -> (2, N)."""
        return self.log_of_white(self.whiten(residuals))

    def log_of_white(self, white: NDArray) -> NDArray:
        """Return what `log_parts` does, of whitened residuals. Shape (2, N, K) -> (2, N)."""
        return self._log_share[:, None] + self._log_scale - 0.5 * np.sum(white**2, axis=2)

    def log(self, residuals: NDArray) -> NDArray:
        """Return ln f(r). Shape (N, K) -> (N,)."""
        return np.logaddexp(*self.log_parts(residuals))

    def log_moved(self, residuals: NDArray, changes: NDArray) -> NDArray:
        """Return ln f(r - h) for each of m changes h.

        Args:
            residuals: r. Shape (N, K).
            changes: h, as columns. Shape (N, K, m).

        Returns:
            Shape (N, m).
        """
        r, h = self.whiten(residuals)[..., None], self.whiten(changes)
        # |W (r - h)|^2 = |W r|^2 - 2 (W r)'(W h) + |W h|^2
        squares = np.sum(r * r, axis=2) - 2.0 * np.sum(r * h, axis=2) + np.sum(h * h, axis=2)
        scale = self._log_share[:, None] + self._log_scale
        return np.logaddexp(*(scale[:, :, None] - 0.5 * squares))

    def log_tail(self, residuals: NDArray, widening: NDArray) -> NDArray:
        """Return ln N(r; 0, c S1) for each of m factors c. Shapes (N, K), (m,) -> (N, m)."""
        squares = np.sum(self.whiten(residuals)[1] ** 2, axis=1)
        spread = squares[:, None] / widening + np.outer(self._dof, np.log(widening))
        return self._log_scale[1][:, None] - 0.5 * spread

    def log_false(self, residuals: NDArray) -> NDArray:
        """Return ln u(r), u a Cauchy distribution about the tail. Shape (N, K) -> (N,).

        A false detection may lie anywhere, near or far:
        u = Gamma((d + 1) / 2) / Gamma(1 / 2) / sqrt(pi^d |S1|) (1 + r' S1^-1 r)^(-(d + 1) / 2)
        (multivariate t of one degree of freedom; Kotz, Nadarajah 2004), d its coordinates. Nearer
        than r' S1^-1 r = d it is as there: in its middle it is e^20 times as dense as the tail
        where 20 coordinates are measured, and residuals that are smaller than expected would look
        like false detections.
        """
        squares = np.maximum(np.sum(self.whiten(residuals)[1] ** 2, axis=1), self._dof)
        rows, which = np.unique(self._dof, return_inverse=True)
        head = np.array([lgamma(0.5 * (d + 1.0)) for d in rows.tolist()])[which.reshape(-1)]
        # As everywhere here, without the normals' (2 pi)^(-d / 2).
        head += 0.5 * (self._dof * np.log(2.0) - np.log(np.pi)) + self._log_scale[1]
        return head - 0.5 * (self._dof + 1.0) * np.log1p(squares)

    def in_noise(self, columns: NDArray) -> NDArray:
        """Return columns whitened by the second moment of the mixture. Shape (N, K, m)."""
        return np.asarray(whitening_of(self.total, self._seen) @ columns)

    def nis(self, residuals: NDArray) -> NDArray:
        """Return r' S^-1 r with S the second moment of the mixture. Shape (N, K) -> (N,)."""
        return np.sum(self.in_noise(residuals[:, :, None])[:, :, 0] ** 2, axis=1)
