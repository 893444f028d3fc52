"""How surprising each pixel of a picture is, after what was expected to be seen there."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only

_ROUNDING = 1.0 / 12.0
"""Least variance of a grey level."""
_PLACE = np.ones((3, 3), np.uint8)
"""Pixels of a place."""
_MIXED = 0.15
"""What colours of an edge mix otherwise by than the expectation's, as a share of what V makes of
them; set on robots 900 and 950."""
_SATURATED = 200.0
"""A mirror in dim light throws back no less of what is as bright as a pixel can be [grey levels]: a
picture of a dark room is not one of a body that is as dark."""
_GAIN_STEPS = 5
"""Times the gain is estimated anew without what does not follow it."""
_CERTAIN = 2.5
"""Standard deviations within which an outline is sure to be."""
_TAPS = 4.0
"""Standard deviations that a Gaussian of whole pixels reaches, and a pixel."""
_FAR_OFF = 3.0
"""Robust standard deviations beyond which a pixel does not tell the gain."""


@dataclass(frozen=True, eq=False)
class Expectation:
    """What a camera is expected to see, and how well that is known."""

    picture: NDArray
    """Expected, BGR, 8 bits. Shape (h, w, 3)."""
    pixel_sigma: NDArray
    """Standard deviation of where it is seen, along each axis; nan where nothing is expected or
    nothing shall be judged [px]. Shape (h, w)."""
    noise: float
    """Standard deviation of a grey level of the camera."""
    appearance_sigma: float | NDArray
    """What colours and light are not known by, as a share of the expected grey level; everywhere,
    or at each pixel. Shape () or (h, w)."""
    light_sigma: float | NDArray = 0.0
    """How much lighter or darker a place may be besides, in all colours alike, likewise: of what is
    turned to the light otherwise than expected."""

    def __post_init__(self) -> None:
        """Check the shapes, and make the arrays read-only."""
        for name in ("appearance_sigma", "light_sigma"):
            shape = np.shape(getattr(self, name))
            if shape not in ((), self.picture.shape[:2]):
                raise ValueError(
                    f"{name} must be a number or have shape {self.picture.shape[:2]}, got {shape}"
                )
        if self.picture.ndim != 3 or self.pixel_sigma.shape != self.picture.shape[:2]:
            raise ValueError(
                "picture and pixel_sigma must have shapes (h, w, 3) and (h, w), got "
                f"{self.picture.shape} and {self.pixel_sigma.shape}"
            )
        object.__setattr__(self, "picture", read_only(self.picture))
        object.__setattr__(self, "pixel_sigma", read_only(self.pixel_sigma, float))
        for name in ("appearance_sigma", "light_sigma"):
            each = np.broadcast_to(np.asarray(getattr(self, name), float), self.pixel_sigma.shape)
            object.__setattr__(self, name, read_only(each))


@dataclass(frozen=True, eq=False)
class Surprise:
    """What one picture differs by from what was expected."""

    chi_square: NDArray
    """z^2 of the place of 3 x 3 pixels about each pixel, of three degrees of freedom; nan where one
    of them is not judged. Shape (h, w)."""
    gain: float
    """How much brighter the picture is than expected."""
    expected: Expectation | None = None
    """What was expected, if it is known."""
    off: NDArray | None = None
    """ē of the judged places, row by row. Shape (n, 3)."""
    covariance: NDArray | None = None
    """Its covariance. Shape (n, 3, 3)."""
    noise: float = 0.0
    """Variance of each colour of a place that is the camera's noise: the rest of the covariance is
    wrong in all pictures alike."""

    def __post_init__(self) -> None:
        """Make the array read-only."""
        object.__setattr__(self, "chi_square", read_only(self.chi_square))

    def alike(self, which: NDArray) -> NDArray:
        """Return what of the covariance of judged places is wrong in all pictures alike.

        Args:
            which: Numbers of the places, or truth values of all. Shape (k,) or (n,).

        Returns:
            Shape (k, 3, 3).

        Raises:
            ValueError: If nothing is known of covariances.
        """
        if self.covariance is None:
            raise ValueError("this surprise has no covariances: take one that `surprise` returned")
        found = self.covariance[which]
        found[:, range(3), range(3)] -= self.noise
        return found

    def share_alike(self, u: float, v: float) -> float:
        """Return which share of a place's covariance is alike in all pictures; 0 if not judged.

        Args:
            u: Column of the place [px].
            v: Row of the place [px].
        """
        judged = np.isfinite(self.chi_square)
        row, column = round(v), round(u)
        if self.covariance is None or not judged[row, column]:
            return 0.0
        k = np.array([judged[:row].sum() + judged[row, :column].sum()])
        return float(np.trace(self.alike(k)[0]) / np.trace(self.covariance[k[0]]))

    def places_beside(self, other: "Surprise") -> NDArray:
        """Return z^2 of this where it judges, and of another of the same picture elsewhere.

        Raises:
            ValueError: If the other has another shape.
        """
        if self.chi_square.shape != other.chi_square.shape:
            raise ValueError(
                f"pictures of one shape can be joined, got {self.chi_square.shape} and "
                f"{other.chi_square.shape}"
            )
        return np.where(np.isfinite(self.chi_square), self.chi_square, other.chi_square)

    def beside(self, other: "Surprise") -> "Surprise":
        """Return this where it judges, and another elsewhere; raises as `places_beside`."""
        each, own = self.places_beside(other), np.isfinite(self.chi_square)
        off, covariance = (
            _rows_beside(own, other.chi_square, *rows)
            for rows in ((self.off, other.off), (self.covariance, other.covariance))
        )
        return Surprise(each, self.gain, self.expected, off, covariance, self.noise)


def _rows_beside(
    own: NDArray, places: NDArray, kept: NDArray | None, added: NDArray | None
) -> NDArray | None:
    """Return rows of judged places of one picture, and of another where it alone judges."""
    if kept is None or added is None:
        return None
    judged = own | np.isfinite(places)
    rows = np.empty((int(judged.sum()), *kept.shape[1:]))
    rows[own[judged]], rows[~own[judged]] = kept, added[~own[np.isfinite(places)]]
    return rows


def as_before(
    picture: NDArray,
    own: Surprise,
    noise: float,
    appearance_sigma: float,
    pixel_sigma: float = 0.0,
) -> Expectation:
    """Return an earlier picture as what is expected now, where the body tells nothing.

    Each place there takes all of its 3 x 3 pixels. Both pictures are noisy.

    Args:
        picture: Taken before, from the same place, BGR. Shape (h, w, 3).
        own: What differs now from the expected body.
        noise: Standard deviation of a grey level of one picture.
        appearance_sigma: What colours and light may have changed by, as a share.
        pixel_sigma: What outlines may have moved by [px].
    """
    untold = np.isnan(own.chi_square).astype(np.uint8)
    known = np.where(cv2.dilate(untold, _PLACE) > 0, pixel_sigma, np.nan)
    return Expectation(picture, known, np.sqrt(2.0) * noise, appearance_sigma)


def surprise(picture: NDArray, expected: Expectation) -> Surprise:
    """Hold a picture against what was expected.

    With the picture I, the expectation E and one gain g for the look, and sums over the n = 9
    pixels of a place,

        z^2 = ē' C^-1 ē,  C = (sum W)^-1,  ē = C sum W e
        W = (s_n^2 1 + n (s_a^2 g^2 diag(M)^2 + s_l^2 g^2 M M' + g^2 V))^-1,  e = I - g M

    The camera's noise is another in each pixel; what colours and places are wrong by is alike in
    neighbours, and does not become less in their mean: (sum a) (sum a)' is n sum a a' at most. A
    pixel at an edge tells less than one beside it.

    s_n is the camera's noise, s_a what colours are not known by, and s_l how light they are. V is
    what the expectation differs by because nobody knows to the pixel where it is seen: with d that
    displacement and S its covariance, M(x) = mean E(x + d) and V(x) = cov E(x + d), both by
    Gaussian blur. For small S it is V = G S G', with G the gradient of the expectation; beyond that
    a gradient would know nothing of an edge two pixels away. An edge is not quite a line between
    two colours, where a third is near or light changes at it: a share of V counts in all directions
    of colour.

    Args:
        picture: BGR, 8 bits. Shape (h, w, 3).

    Returns:
        The chi-square picture and the gain.

    Raises:
        ValueError: If the picture has another shape, or nothing of it is to be judged.
    """
    judged, off, alike, noise, gain = held_against(picture, expected)
    border = {"borderType": cv2.BORDER_CONSTANT, "borderValue": (0.0,)}
    whole = cv2.erode(judged.astype(np.uint8), _PLACE, **border) > 0
    alike *= _PLACE.size
    alike[:, range(3), range(3)] += noise
    weight = np.linalg.inv(alike)
    del alike  # as large as all that a picture of the room tells
    told = np.einsum("nij,nj->ni", weight, off)
    sums = np.stack([_sum_at(judged, whole, told[:, i]) for i in range(3)], axis=1)
    total = np.empty((len(sums), 3, 3))
    for i, j in _PAIRS:
        total[:, i, j] = total[:, j, i] = _sum_at(judged, whole, weight[:, i, j])
    del weight
    covariance = np.linalg.inv(total)
    mean = np.einsum("nij,nj->ni", covariance, sums)
    chi_square = np.full(judged.shape, np.nan)
    chi_square[whole] = np.sum(mean * sums, axis=1)
    return Surprise(chi_square, gain, expected, mean, covariance, noise / _PLACE.size)


def _sum_at(judged: NDArray, whole: NDArray, each: NDArray) -> NDArray:
    """Return the sums over 3 x 3 pixels of what is known at all judged ones, at the whole ones."""
    picture = np.zeros(judged.shape)
    picture[judged] = each
    return cv2.boxFilter(picture, -1, _PLACE.shape, normalize=False)[whole]


def log_likelihood(picture: NDArray, expected: Expectation) -> NDArray:
    """Return how likely each pixel is, of what was expected: - (log det C + e' C^-1 e) / 2.

    C is the covariance of one pixel. It tells which of several `pixel_sigma` pictures of
    what was expected really have.

    Args:
        picture: BGR, 8 bits. Shape (h, w, 3).

    Returns:
        nan where nothing is judged. Shape (h, w).

    Raises:
        ValueError: If the picture has another shape, or nothing of it is to be judged.
    """
    judged, off, total, noise, _ = held_against(picture, expected)
    total[:, range(3), range(3)] += noise
    chi_square = np.sum(off * np.linalg.solve(total, off[:, :, None])[:, :, 0], axis=1)
    likely = np.full(judged.shape, np.nan)
    likely[judged] = -0.5 * (np.linalg.slogdet(total)[1] + chi_square)
    return likely


def held_against(
    picture: NDArray, expected: Expectation, gain: float | None = None
) -> tuple[NDArray, NDArray, NDArray, float, float]:
    """Return what `surprise` is made of, pixel by pixel.

    Args:
        picture: BGR, 8 bits. Shape (h, w, 3).
        gain: How much brighter the picture is; found if omitted.

    Returns:
        What is judged, shape (h, w); e, shape (n, 3); its covariance without the noise, shape
        (n, 3, 3); the variance of the noise; and the gain.

    Raises:
        ValueError: If the picture has another shape, or nothing of it is to be judged.
    """
    if picture.shape != expected.picture.shape:
        raise ValueError(
            f"a picture of shape {expected.picture.shape} was expected, got {picture.shape}"
        )
    judged = np.isfinite(expected.pixel_sigma)
    if not judged.any():
        raise ValueError("nothing of the picture is to be judged: is the body in view?")
    mean, covariance = _displaced(expected, judged)
    seen = picture.astype(float)[judged]
    noise = expected.noise**2 + _ROUNDING
    share, light = (
        np.asarray(each)[judged][:, None]
        for each in (expected.appearance_sigma, expected.light_sigma)
    )
    own = noise + (share**2 + light**2) * mean**2
    if gain is None:
        gain = _gain(seen, mean, own + np.einsum("nii->ni", covariance))
    alike = gain**2 * covariance
    edge = _MIXED**2 / 3.0 * np.einsum("nii->n", alike)[:, None]
    alike[:, range(3), range(3)] += edge + np.square(share * gain * mean)
    lighter = light * gain * mean
    alike += lighter[:, :, None] * lighter[:, None]
    # Nothing is brighter than a pixel can be, or what a mirror throws back of that.
    brightest = max(_SATURATED, float(cv2.blur(picture, _PLACE.shape)[judged].max()))
    return judged, seen - np.minimum(gain * mean, brightest), alike, noise, gain


def away_from_the_unknown(pixel_sigma: NDArray) -> NDArray:
    """Return where a body may be judged: not where what is behind it may be seen in its place.

    Args:
        pixel_sigma: Of where it is seen; nan where nothing is known of what is seen [px]. (h, w).

    Returns:
        The same, nan also where something unknown is within 2.5 of the sigma there, and a pixel.
    """
    unknown = (~np.isfinite(pixel_sigma)).astype(np.uint8)
    found = np.array(pixel_sigma, dtype=float)
    for sigma in np.unique(pixel_sigma[unknown == 0]).tolist():
        reach = int(np.ceil(_CERTAIN * sigma)) + 1
        window = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
        found[(pixel_sigma == sigma) & (cv2.dilate(unknown, window) > 0)] = np.nan
    return found


def about_the_loose(pixel_sigma: NDArray) -> NDArray:
    """Return where something may be seen that is not known well. Shape (h, w).

    Args:
        pixel_sigma: Of where it is seen; nan where it is not expected [px]. Shape (h, w).

    Returns:
        Truth values: what is within 2.5 of the sigma of one of its pixels, and a pixel.
    """
    reach = np.ceil(_CERTAIN * pixel_sigma) + 1.0
    found = np.zeros(reach.shape, dtype=bool)
    for size in np.unique(reach[np.isfinite(reach)]).astype(int).tolist():
        window = np.ones((2 * size + 1, 2 * size + 1), np.uint8)
        found |= cv2.dilate((reach == size).astype(np.uint8), window) > 0
    return found


def _displaced(expected: Expectation, judged: NDArray) -> tuple[NDArray, NDArray]:
    """Return mean and covariance of the expectation over its displacements. (n, 3), (n, 3, 3)."""
    picture = expected.picture.astype(np.float32)
    products = np.stack([picture[:, :, i] * picture[:, :, j] for i, j in _PAIRS], axis=2)
    mean = np.zeros((int(judged.sum()), 3))
    covariance = np.zeros((len(mean), 3, 3))
    sigmas = expected.pixel_sigma[judged]
    for sigma in np.unique(sigmas).tolist():
        rows = sigmas == sigma
        first, second = (_blurred(part, sigma)[judged][rows] for part in (picture, products))
        mean[rows] = first
        for k, (i, j) in enumerate(_PAIRS):
            covariance[rows, i, j] = covariance[rows, j, i] = (
                second[:, k] - first[:, i] * first[:, j]
            )
    covariance[:, range(3), range(3)] = np.maximum(covariance[:, range(3), range(3)], 0.0)
    return mean, covariance


_PAIRS: Sequence[tuple[int, int]] = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _blurred(picture: NDArray, sigma: float) -> NDArray:
    """Return a picture's mean over displacements of a standard deviation, however small it is.

    The Gaussian of whole pixels is exp(-t) I_n(t), t = sigma^2, of variance t and of the transform
    exp(t (cos w - 1)) (Lindeberg 1990, scale-space for discrete signals).
    """
    if sigma <= 0.0:
        return picture
    reach = int(np.ceil(_TAPS * sigma)) + 1
    w = 2.0 * np.pi * np.fft.rfftfreq(2 * reach + 1)
    taps = np.fft.irfft(np.exp(sigma**2 * (np.cos(w) - 1.0)), 2 * reach + 1)
    taps = np.roll(taps, reach)
    return cv2.sepFilter2D(picture, -1, taps, taps)


def _gain(seen: NDArray, expected: NDArray, variance: NDArray) -> float:
    """Return g of seen = g expected, by weighted least squares without what is far off."""
    weight = 1.0 / variance
    gain = float(np.median(seen.sum(axis=1) / np.maximum(expected.sum(axis=1), 1.0)))
    for _ in range(_GAIN_STEPS):
        off = (seen - gain * expected) * np.sqrt(weight)
        scale = max(1.4826 * float(np.median(np.abs(off))), 1e-9)
        used = weight * (np.abs(off) < _FAR_OFF * scale)
        gain = float((used * seen * expected).sum() / (used * expected**2).sum())
    return gain
