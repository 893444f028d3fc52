"""Where mirrors stand, and joints that nobody commands, told by the own unmarked body in a mirror.

The hand in a mirror tells its plane by some points; head and chest tell it by all of their edges,
and how the head stands on the neck as well. A picture I differs from the expectation E by a gain g
and by displacements of what is seen (Lucas and Kanade 1981, of a whole body at once):

    I - g E = - g grad E . (du/dm dm + du/dq dq + du/dc dc) + g dE/dl dl + g E (dg + r) + noise

with m the mirror's values, q motions of the body, of joints that stand still and of the whole, l
how the room's light is turned about the robot and r what the colours of paints are off by, where
these are asked for, and c what the cameras may be wrong by, where that is asked for: it looks like
a mirror and a body that stand elsewhere, in all mirrors alike. Shades that lie elsewhere look like
a body that is turned, and so does a paint that is darker than its neighbour: taken for known, light
and colours would hold the body where it is. A part that turns about an axis turns below the light,
which stands still: its shades move with it, and back as if the light were turned the other way, by
- g dE/dl axis. It is solved by weighted least squares with what was known before; whoever calls
renders E anew and repeats it. Where one part of a body hides another the edge between them moves
with the nearer one, on both of its sides (`whose_edge`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.observations.hand_rows import project_to_cameras
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import reflected_projection
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.optimization.uncertainty import inverse_of

_LEAST_SLOPE = 1.5
"""What changes by less from pixel to pixel tells no place [grey levels]."""
_FAR_OFF = 2.5
"""Robust standard deviations from which on a grey level counts less (Huber)."""
_FEWEST = 200
"""Grey levels that an alignment takes."""
_GAIN_SIGMA = 0.1
"""What the gain of a picture may be off by that is found from pixel to pixel."""


@dataclass(frozen=True, eq=False)
class AlignedView:
    """What one camera saw and expected in one mirror, both smoothed alike."""

    side: int
    """Which camera, 0 or 1."""
    mirror: int
    """Which mirror."""
    seen: NDArray
    """BGR. Shape (h, w, 3)."""
    expected: NDArray
    """BGR. Shape (h, w, 3)."""
    depth: NDArray
    """To where the reflection seems to be [m]. Shape (h, w)."""
    used: NDArray
    """Which pixels show what stands still, away from what is not known. Shape (h, w)."""
    moved: NDArray
    """Which pixels each motion of the body moves. Shape (k, h, w)."""
    by_light: NDArray | None = None
    """What turned light changes of what is expected; None where it is known how the light stands
    [grey levels/rad]. Shape (h, w, 3, 3)."""
    paints: NDArray | None = None
    """Which paint of the body each pixel shows, less than 0 for none; None where it is not asked
    what colours these have. Shape (h, w)."""


@dataclass(frozen=True, eq=False)
class BodyMotion:
    """One way in which a part of the body may stand elsewhere."""

    direction: NDArray
    """In which it shifts, or the axis about which it turns, in the rig's world. Shape (3,)."""
    p_WJ: NDArray | None
    """A point of that axis [m]; None if it shifts. Shape (3,)."""

    def way(self, p_WQ: NDArray) -> NDArray:
        """Return how points move by it [m/rad, m/m]. Shape (N, 3)."""
        if self.p_WJ is None:
            return np.broadcast_to(self.direction, p_WQ.shape)
        return np.cross(self.direction, p_WQ - self.p_WJ)


@dataclass(frozen=True, eq=False)
class Alignment:
    """What a step of an alignment found."""

    change: NDArray
    """Of the values of all mirrors in turn, the body's motions, the light's turn where views tell
    of it, and what cameras may be wrong by. Shape (n,)."""
    covariance: NDArray
    """Of these. Shape (n, n)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        object.__setattr__(self, "change", read_only(self.change))
        object.__setattr__(self, "covariance", read_only(self.covariance))

    @property
    def sigmas(self) -> float:
        """Size of the change, in standard deviations of what is known then."""
        return float(np.sqrt(self.change @ np.linalg.solve(self.covariance, self.change)))


def alignment_step(
    views: Sequence[AlignedView],
    rig: StereoRig,
    mirrors: Sequence[Mirror],
    motions: Sequence[BodyMotion],
    before: tuple[NDArray, NDArray],
    area: float,
    cameras: Sequence[str] = (),
    colors: tuple[NDArray, float] | None = None,
) -> Alignment:
    """Return how mirrors and body must change for the body to look as it does.

    Args:
        views: What was seen and expected; every mirror in at least one.
        mirrors: Where the mirrors were expected to stand.
        motions: How the body may stand elsewhere; k of them.
        before: What was known before the pictures: how far the values are from it, shape (n,), and
            its covariance.
        area: Pixels that err alike: smoothed ones, and of one surface.
        cameras: Parameters of the rig that may be wrong, of its `names`; c of them.
        colors: How far red, green and blue of each paint are from what was known before, as shares,
            shape (K, 3), and their sigma; None where it is not asked what colours there are.

    Returns:
        The change, and the covariance of what it leads to.

    Raises:
        EstimationError: If the pictures tell hardly any place.
    """
    off, prior = before
    n, paints = len(off), 0 if colors is None else colors[0].size
    known = np.zeros((n + paints,) * 2)
    known[:n, :n] = inverse_of(prior)
    if colors is not None:
        known[range(n, n + paints), range(n, n + paints)] = colors[1] ** -2
        off = np.append(off, colors[0])
    information, gradient = known, -known @ off
    levels = 0
    for view in views:
        rows = _equations(view, rig, mirrors, motions, cameras)
        own, pull = _normal_equations(rows, area, paints)
        information, gradient = information + own, gradient + pull
        levels += len(rows.errors)
    if levels < _FEWEST:
        raise EstimationError(
            f"only {levels} grey levels of the body in the mirror tell where it is, at least "
            f"{_FEWEST} are needed: is the body in view?"
        )
    covariance = inverse_of(information)
    return Alignment((covariance @ gradient)[:n], covariance[:n, :n])


@dataclass(frozen=True, eq=False)
class _Levels:
    """Grey levels that tell something, of one picture."""

    slopes: NDArray
    """By what is estimated. Shape (L, n)."""
    expected: NDArray
    """With the picture's gain. Shape (L,)."""
    errors: NDArray
    """What was seen beyond that. Shape (L,)."""
    cells: NDArray
    """Which colour of which paint each shows, -1 where that is not known. Shape (L,)."""


def _normal_equations(rows: _Levels, area: float, paints: int) -> tuple[NDArray, NDArray]:
    """Return J' W J and J' W r of one picture by what is estimated and the colours of paints.

    Its gain, which is of this picture alone, is eliminated.
    """
    errors, expected = rows.errors, rows.expected
    scale = max(1.4826 * float(np.median(np.abs(errors))), 0.3) if len(errors) else 1.0
    share = np.minimum(1.0, _FAR_OFF * scale / np.maximum(np.abs(errors), 1e-9))
    weight = share / (scale**2 * 3.0 * area)
    n = rows.slopes.shape[1]
    H, pull, by_gain = np.zeros((n + paints,) * 2), np.zeros(n + paints), np.zeros(n + paints)
    H[:n, :n] = rows.slopes.T @ (weight[:, None] * rows.slopes)
    pull[:n] = rows.slopes.T @ (weight * errors)
    by_gain[:n] = rows.slopes.T @ (weight * expected)
    if paints:
        shown, cells = weight * expected * (rows.cells >= 0), np.maximum(rows.cells, 0)

        def each(values: NDArray) -> NDArray:
            return np.bincount(cells, shown * values, paints)

        H[:n, n:] = [each(column) for column in rows.slopes.T]
        H[n:, :n] = H[:n, n:].T
        by_gain[n:], pull[n:] = each(expected), each(errors)
        H[range(n, n + paints), range(n, n + paints)] = by_gain[n:]
    own = float(np.sum(weight * expected**2)) + _GAIN_SIGMA**-2
    H -= np.outer(by_gain, by_gain) / own
    return H, pull - by_gain * float(np.sum(weight * expected * errors)) / own


def _equations(
    view: AlignedView,
    rig: StereoRig,
    mirrors: Sequence[Mirror],
    motions: Sequence[BodyMotion],
    cameras: Sequence[str],
) -> _Levels:
    """Return derivatives of grey levels by what is estimated, and what they are off by."""
    down, right = np.gradient(view.expected, axis=(0, 1))
    steep = view.used & (np.hypot(right, down).max(axis=2) > _LEAST_SLOPE)
    rows, columns = np.nonzero(steep)
    moved = 3 * len(mirrors) + len(motions)
    lit = 0 if view.by_light is None else 3
    size = moved + lit + len(cameras)
    if not len(rows):
        nothing = np.zeros(0)
        return _Levels(np.zeros((0, size)), nothing, nothing, nothing.astype(int))
    used = view.seen[view.used], view.expected[view.used]
    gain = float(np.median(used[0].sum(axis=1) / np.maximum(used[1].sum(axis=1), 1.0)))
    by_value = _pixel_slopes(view, rig, mirrors[view.mirror], motions, cameras, rows, columns)
    own = np.zeros((len(rows), 2, size))
    own[:, :, 3 * view.mirror : 3 * view.mirror + 3] = by_value[:, :, :3]
    own[:, :, 3 * len(mirrors) : moved] = by_value[:, :, 3 : 3 + len(motions)]
    own[:, :, moved + lit :] = by_value[:, :, 3 + len(motions) :]
    slope = np.stack([right[rows, columns], down[rows, columns]], axis=2)
    # Where a thing moves to the right, a grey level becomes that of its left: - grad E . du.
    slopes = -gain * slope @ own
    if view.by_light is not None:
        by_light = gain * view.by_light[rows, columns]
        slopes[:, :, moved : moved + lit] = by_light
        for k, (motion, turned) in enumerate(zip(motions, view.moved, strict=True)):
            if motion.p_WJ is not None:
                shades = (by_light @ motion.direction) * turned[rows, columns][:, None]
                slopes[:, :, 3 * len(mirrors) + k] -= shades
    expected = gain * view.expected[rows, columns]
    errors = view.seen[rows, columns] - expected
    return _Levels(
        slopes.reshape(-1, size), expected.ravel(), errors.ravel(), _cells(view, rows, columns)
    )


def _cells(view: AlignedView, rows: NDArray, columns: NDArray) -> NDArray:
    """Return 3 times the paint of each grey level, and its colour, red first. Shape (3 N,)."""
    if view.paints is None:
        return np.full(3 * len(rows), -1)
    paint = view.paints[rows, columns].astype(int)[:, None]
    return np.where(paint < 0, -1, 3 * paint + np.array([2, 1, 0])).ravel()


def _pixel_slopes(
    view: AlignedView,
    rig: StereoRig,
    mirror: Mirror,
    motions: Sequence[BodyMotion],
    cameras: Sequence[str],
    rows: NDArray,
    columns: NDArray,
) -> NDArray:
    """Return how pixels of reflections move by mirror, body, cameras. Shape (N, 2, 3 + k + c)."""
    camera = rig.cameras[view.side]
    behind = camera.at_depth(np.stack([columns, rows], axis=1), view.depth[rows, columns])
    plane = mirror.plane_in(rig.left.X_WC)
    p_WQ = reflect(plane, behind)
    found = reflected_projection(rig.cameras, mirror.values, p_WQ)
    own = slice(2 * view.side, 2 * view.side + 2)
    slopes = [found.by_mirror[:, own]]
    for motion, moved in zip(motions, view.moved, strict=True):
        way = motion.way(p_WQ) * moved[rows, columns][:, None]
        slopes.append(np.einsum("nij,nj->ni", found.by_point[:, own], way)[:, :, None])
    if cameras:
        p_LQ = apply(rig.left.X_CW, behind)
        by_rig = project_to_cameras(p_LQ.T, rig.values, rig.lenses)[2]
        wrong = [rig.names.index(name) for name in cameras]
        slopes.append(by_rig[wrong, own].transpose(2, 1, 0))
    return np.concatenate(slopes, axis=2)
