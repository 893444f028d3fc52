"""Backlash as a witness: what the joints err by shows in the hand and in its mirror image alike.

Who imitates has joints of his own, which err otherwise, wherever he stands. The hand is x ~ N(0, C)
off where encoders expect it, C of the joints' noise; seen directly it is found at e = x + d, with
d ~ N(0, D) of the pixels; its image is r = G x + n off, with G the derivative of reflected pixels
and n theirs. A mirror's image follows what was seen directly, another's does not:

    r | e ~ N(G K e, G (C - K C) G' + N),  K = C (C + D)^-1,    against    r ~ N(0, G C G' + N).

The sum of the logarithms of their ratio says which (Bishop 2006, 2.3).
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.cameras.mirror_rig import MirrorRig

_MOST_BY_ONE = 3.0
"""What one look may say at most, for or against: a marker that was located badly is no evidence."""


def shared_error(
    pixels: NDArray,
    own: NDArray,
    expected: NDArray,
    noise: NDArray,
    rig: MirrorRig,
    pixel_sigma: float,
) -> float:
    """Return how much likelier it is that an image errs as the own hand does than by itself.

    Args:
        pixels: Where the image was seen, left u, v, right u, v [px]. Shape (N, 4).
        own: Where the own hand was seen directly, nan where it was not [px]. Shape (N, 4).
        expected: Where the encoders have the hand [m]. Shape (N, 3).
        noise: Covariance of what the joints add to it [m^2]. Shape (N, 3, 3).
        rig: The cameras before the mirror that explains the image best.
        pixel_sigma: Standard deviation of a pixel coordinate [px].

    Returns:
        Logarithm of the odds, 0 where no look shows both, or joints hardly err.
    """
    left, right = rig.rig.cameras
    seen = np.isfinite(own).all(axis=1) & left.has_rays(own[:, :2]) & right.has_rays(own[:, 2:])
    direct = rig.rig.triangulate(own[seen], pixel_sigma)
    C, D = noise[seen], direct.covariance
    e = (direct.p_WQ - expected[seen])[..., None]
    reflected = rig.projection(expected[seen])
    G, r = reflected.by_point, (pixels[seen] - reflected.pixels)[..., None]
    N = pixel_sigma**2 * np.eye(4)
    K = C @ np.linalg.inv(C + D)
    together = _log_density(r - G @ K @ e, G @ (C - K @ C) @ np.swapaxes(G, 1, 2) + N)
    alone = _log_density(r, G @ C @ np.swapaxes(G, 1, 2) + N)
    return float(np.clip(together - alone, -_MOST_BY_ONE, _MOST_BY_ONE).sum())


def _log_density(r: NDArray, covariance: NDArray) -> NDArray:
    """Return log N(r; 0, C) up to a constant, for r of shape (N, 4, 1). Shape (N,)."""
    squares = np.sum(r * np.linalg.solve(covariance, r), axis=(1, 2))
    return np.asarray(-0.5 * (squares + np.linalg.slogdet(covariance)[1]))
