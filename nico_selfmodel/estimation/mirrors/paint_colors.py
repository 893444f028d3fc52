"""What colours the paints of the own body have, told by how it looks in mirrors.

A robot's description names its paints, and knows their colours as somebody chose them. With M what
is expected of a grey level, of a colour c of paint k, the picture p has

    I = g_p r_kc M + noise

with one gain g_p for the picture and r what the colours are off by: bilinear, solved by
Gauss-Newton with the description as what was known before. A common brightness of all paints is the
pictures' gain: of the colours that are told their mean is held (a gauge), in the covariance too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.estimation.mirrors.body_alignment import AlignedView
from nico_selfmodel.optimization.uncertainty import inverse_of

DESCRIBED_SIGMA = 0.15
"""What colours of a description are not known by, as a share: they were chosen by sight."""
_GAIN_SIGMA = 0.3
"""What the gain of a picture may be off by."""
_BRIGHTEST = 250.0
"""Grey level from which on a pixel is no longer as bright as what it shows."""
_SLIPPED = 0.5
"""What an expected place may be off by [px]."""
_FAR_OFF = 2.5
"""Robust standard deviations from which on a grey level counts less (Huber)."""
_DARK = 0.02
"""No paint is darker [of 1]; of what is expected to be black nothing could be told."""
_ROUNDS, _STEPS = 3, 6
"""Of weights anew, and of Gauss-Newton."""


@dataclass(frozen=True, eq=False)
class PaintColors:
    """The colours of all paints."""

    described: NDArray
    """Red, green and blue by the description, of 1, none quite black. Shape (K, 3)."""
    colors: NDArray
    """As they are. Shape (K, 3)."""
    covariance: NDArray
    """Of each paint's colour, as shares of it, where all is lit as expected. Shape (K, 3, 3)."""

    def __post_init__(self) -> None:
        """Check the shapes and make the arrays read-only."""
        size = (len(self.described), 3)
        for name, shape in (("described", size), ("colors", size), ("covariance", (*size, 3))):
            object.__setattr__(self, name, frozen_array(getattr(self, name), shape, name))

    @classmethod
    def by_description(cls, described: NDArray) -> "PaintColors":
        """Return what is known of paints that were never seen. Shape (K, 3)."""
        unknown = np.tile(DESCRIBED_SIGMA**2 * np.eye(3), (len(described), 1, 1))
        colors = np.clip(described, _DARK, 1.0)
        return cls(colors, colors, unknown)

    @property
    def sigma(self) -> NDArray:
        """What each paint is not known by, as a share: root mean square of its colours. (K,)."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2) / 3.0)

    @property
    def off(self) -> NDArray:
        """How far colours are from those of the description, as shares. Shape (K, 3)."""
        return self.colors / self.described - 1.0

    def seen_in(self, views: Sequence[AlignedView], area: float) -> "PaintColors":
        """Return the colours that pictures tell, which were expected with these.

        Args:
            views: What was seen and expected, with paints.
            area: Pixels that err alike.

        Returns:
            The same where nothing is told.
        """
        count = len(self.described)
        each = [_sums(view, count, area, len(views)) for view in views]
        weight, seen = (np.array(part) for part in zip(*each, strict=True))
        told = weight.sum(axis=0)
        if not told.any():
            return self
        off, covariance = _shares(weight, seen, (self.described / self.colors).ravel())
        # The common brightness of what is told is the pictures' gain.
        hold = np.eye(len(off)) - np.outer(np.where(told > 0.0, off, 0.0), told / (told @ off))
        covariance = hold @ covariance @ hold.T / np.outer(off, off)
        off[told > 0.0] *= told.sum() / (told @ off)
        blocks = covariance.reshape(count, 3, count, 3)[range(count), :, range(count)]
        colors = np.clip(self.colors * off.reshape(count, 3), _DARK, 1.0)
        return PaintColors(self.described, colors, blocks)


def _sums(view: AlignedView, count: int, area: float, pictures: int) -> tuple[NDArray, NDArray]:
    """Return what one picture's paints are off by, sum w M I / sum w M^2, and its information.

    w is what a pixel tells, less where an edge may lie elsewhere. All edges of a small shape may do
    so alike, by d, and in all P pictures: that does not become less in their mean. With s the noise
    and a the pixels that err alike, the information is

        1 / (s^2 a / sum w M^2 + P b^2),  b = sum w M d |grad M| / sum w M^2

    Returns:
        Information and share, red first. Shape (3 K,) each.
    """
    down, right = np.gradient(view.expected, axis=(0, 1))
    assert view.paints is not None
    inside = view.used & (view.paints >= 0)
    expected, seen = view.expected[inside].astype(float), view.seen[inside].astype(float)
    edge = _SLIPPED**2 * (down[inside].astype(float) ** 2 + right[inside].astype(float) ** 2)
    shown = np.maximum(expected, seen).max(axis=1) < _BRIGHTEST
    cell = 3 * view.paints[inside].astype(int)[:, None] + np.array([2, 1, 0])
    w = shown[:, None] / (1.0 + edge)
    share, scale = np.ones_like(w), 1.0
    for _ in range(_ROUNDS):
        found = _ratio(cell, share * w, expected, seen, count)
        errors = (seen - found[cell] * expected) / np.sqrt(1.0 + edge)
        scale = max(1.4826 * float(np.median(np.abs(errors[shown]))), 0.3) if shown.any() else 1.0
        share = np.minimum(1.0, _FAR_OFF * scale / np.maximum(np.abs(errors), 1e-9))
    w *= share
    level = np.maximum(_total(cell, w * expected**2, count), 1e-12)
    slipped = _total(cell, w * expected * np.sqrt(edge), count) / level
    told = 1.0 / (scale**2 * area / level + pictures * slipped**2)
    return np.where(level > 1e-12, told, 0.0), _ratio(cell, w, expected, seen, count)


def _ratio(cell: NDArray, w: NDArray, expected: NDArray, seen: NDArray, count: int) -> NDArray:
    level = _total(cell, w * expected**2, count)
    return _total(cell, w * expected * seen, count) / np.maximum(level, 1e-12)


def _total(cell: NDArray, values: NDArray, count: int) -> NDArray:
    return np.bincount(cell.ravel(), values.ravel(), 3 * count)


def _shares(weight: NDArray, seen: NDArray, prior: NDArray) -> tuple[NDArray, NDArray]:
    """Return r of all colours and their covariance.

    Args:
        weight: Of each picture's colours. Shape (P, 3 K).
        seen: I / M of each. Shape (P, 3 K).
        prior: Of r, by the description. Shape (3 K,).
    """
    pictures, size = weight.shape
    r, g = np.array(prior), np.ones(pictures)
    information = np.zeros((size + pictures,) * 2)
    for _ in range(_STEPS):
        error = seen - g[:, None] * r
        by_r, by_g = weight * g[:, None], weight * r
        information[:size, :size] = np.diag((by_r * g[:, None]).sum(axis=0) + 1.0 / (
            DESCRIBED_SIGMA * prior) ** 2)  # fmt: skip
        information[size:, size:] = np.diag((by_g * r).sum(axis=1) + _GAIN_SIGMA**-2)
        information[size:, :size] = by_r * r
        information[:size, size:] = information[size:, :size].T
        pull = np.append(
            (by_r * error).sum(axis=0) + (prior - r) / (DESCRIBED_SIGMA * prior) ** 2,
            (by_g * error).sum(axis=1) + (1.0 - g) / _GAIN_SIGMA**2,
        )
        step = np.linalg.solve(information, pull)
        r, g = r + step[:size], g + step[size:]
    # What pictures do not agree on beyond what their pixels scatter by is no noise of theirs.
    told = weight.sum(axis=0) > 0.0
    beyond = float((weight * (seen - g[:, None] * r) ** 2).sum())
    freedom = max(int((weight > 0.0).sum()) - int(told.sum()) - pictures, 1)
    covariance = inverse_of(information)[:size, :size] * max(1.0, beyond / freedom)
    return r, covariance
