"""How sharp corners are: by how large squares are there, how far out they lie, and one by one.

Corners of small or slanted squares, at the image's edge, are less sharp than others, and tell most
of a lens. With e a residual and h its leverage, e^2 / (1 - h) is its variance as it alone tells it,
unbiased where all are alike (MacKinnon, White 1985: HC2). All of them together tell

    log s_i^2 = a_c + a_1 |q_i - m|^2 + a_2 log d_i,

c the camera, m the middle of its image, d the way to the nearest neighbour: a gamma model, found
by Fisher's scoring (McCullagh, Nelder 1989, chapter 8), where its likelihood gains more than
chance. A few corners far out tell most of a lens: each by itself, they say its sigma to 7 % where
all are alike; by this model to 2 to 4 %.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.optimization.separable_block import Parts, SeparableBlock

_LEAST_LEFT = 0.1
"""Share of a residual, at least, that counts as not taken up by what it alone tells."""
_CHANCE = 0.01
"""Probability of as large a gain by chance, where corners are all alike."""
_STEPS, _FARTHEST = 20, 1.0
"""Steps of the scoring, and how far one may go: variances change by e at most."""


def corner_noise(
    views: BoardViews, parts: Parts, jacobian: NDArray, counted: NDArray
) -> tuple[NDArray, NDArray]:
    """Return the variance of each residual as it alone tells it, and as all of them tell it.

    Args:
        parts: Where the adjustment ended, views that do not count among them.
        jacobian: By the free camera parameters, boards eliminated; zero of views that do not count.
            Shape (V k, s).
        counted: Which views count. Boolean, shape (V,).

    Returns:
        Shapes (V k,); zero of what was not seen, and where corners have no noise.
    """
    q = np.linalg.qr(jacobian)[0]
    h = SeparableBlock.own_leverage(parts) + np.sum(q * q, axis=1)
    alone = parts[0].ravel() ** 2 / np.maximum(1.0 - h, _LEAST_LEFT)
    seen = np.repeat((views.seen & counted[:, None, None])[:, :, None], 2, axis=2).ravel()
    expected = np.zeros_like(alone)
    if alone[seen].any():
        expected[seen] = by_place(alone[seen], covariates(views)[seen])
    return alone, expected


def by_place(alone: NDArray, z: NDArray) -> NDArray:
    """Return what variances are expected to be; all alike where place and size tell nothing.

    Args:
        alone: As each alone tells it. Shape (n,).
        z: What they may depend on, columns that sum to a constant first. Shape (n, c).

    Returns:
        Variances, in the square of the unit of residuals. Shape (n,).
    """
    size = np.log(alone.mean())
    a = np.linalg.lstsq(z, np.full(len(z), size), rcond=None)[0]
    for _ in range(_STEPS):
        step = np.linalg.lstsq(z, alone / np.exp(z @ a) - 1.0, rcond=None)[0]
        a = a + step * min(1.0, _FARTHEST / max(float(np.abs(z @ step).max()), 1e-12))
    expected = np.exp(z @ a)
    gain = float(np.sum(size + alone / np.exp(size) - z @ a - alone / expected))
    # Of squares of Gaussian noise the variance is two; of tails as they are, more.
    tails = max(0.5 * float(np.mean((alone / expected - 1.0) ** 2)), 1.0)
    alike = chi_square_tail(gain / tails, z.shape[1] - 1) > _CHANCE
    return np.full_like(expected, np.exp(size)) if alike else expected


def covariates(views: BoardViews) -> NDArray:
    """Return which camera saw each coordinate, how far out, and how large squares are there.

    The camera as a one among zeros, the squared way to its image's middle in squares of the half
    diagonal, and the logarithm of the way to the nearest neighbour [px]; its mean where none was
    seen. Shape (V C 2 P, C + 2), as residuals are laid out.
    """
    count = len(views.cameras)
    q = np.moveaxis(views.pixels.reshape(len(views), -1, count, 2), 2, 1)
    middle = 0.5 * (np.array(views.image_sizes, dtype=float) - 1.0)
    out = np.sum((q - middle[:, None]) ** 2, axis=3) / np.sum(middle**2, axis=1)[:, None]
    near = [np.linalg.norm(q - q[:, :, k], axis=3) for k in _neighbours(views.p_GQ)]
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.log(np.fmin(*near))
    told = np.isfinite(size)
    size = np.where(told, size, size[told].mean() if told.any() else 0.0)
    whose = np.broadcast_to(np.eye(count)[None, :, None], (*size.shape, count))
    z = np.concatenate([whose, np.nan_to_num(out)[..., None], size[..., None]], axis=3)
    return np.repeat(z[:, :, None], 2, axis=2).reshape(-1, count + 2)


def _neighbours(p_GQ: NDArray) -> list[NDArray]:
    """Return the nearest point along x and along y of each point of a board. Shapes (P,)."""
    apart = np.abs(p_GQ[None, :, :2] - p_GQ[:, None, :2])
    far = np.where(np.eye(len(p_GQ), dtype=bool), np.inf, np.hypot(apart[..., 0], apart[..., 1]))
    across = apart[..., 0] < apart[..., 1]
    return [np.argmin(np.where(way, far, np.inf), axis=1) for way in (~across, across)]
