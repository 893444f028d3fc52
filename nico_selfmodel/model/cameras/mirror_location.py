"""The mirror as an instrument: where things are that only their reflections show."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig

_LEFT_OUT = 0.1
"""What lenses and detectors leave out, beside the noise of a pixel coordinate [px]."""
_LARGEST_CHI_SQUARE = 25.0
"""Of one degree of freedom: two lines of sight to one thing pass each other by so much once in two
million times."""


@dataclass(frozen=True, eq=False)
class MirrorLocation:
    """Where one thing is that was seen in a mirror."""

    p_WQ: NDArray
    """The thing, in front of the glass [m]. Shape (3,)."""
    covariance: NDArray
    """From the pixels and from what is not known of the mirror; larger where the lines of sight
    miss each other by more than the noise lets them [m^2]. Shape (3, 3)."""
    sight: NDArray
    """Unit vector of the last stretch of the left camera's line of sight. Shape (3,)."""
    miss: float
    """Distance of the pixels from where such a thing would be seen, rms of the cameras [px]."""
    chi_square: float
    """The squared miss over its expectation, of one degree of freedom."""
    in_front_by: float
    """Distance from the glass [m]."""

    @property
    def sigma(self) -> float:
        """Root of the mean variance of a coordinate [m]."""
        return float(np.sqrt(np.trace(self.covariance) / 3.0))

    @property
    def sigma_along(self) -> float:
        """Standard deviation along the line of sight, where stereo is weak [m]."""
        return float(np.sqrt(self.sight @ self.covariance @ self.sight))

    @property
    def sigma_across(self) -> float:
        """Root of the mean variance across the line of sight [m]."""
        rest = np.trace(self.covariance) - self.sight @ self.covariance @ self.sight
        return float(np.sqrt(max(rest, 0.0) / 2.0))

    def as_document(self) -> dict[str, float]:
        """Return plain numbers, as `locate --json` prints them."""
        x, y, z = self.p_WQ.tolist()
        return {
            "x_m": x,
            "y_m": y,
            "z_m": z,
            "sigma_mm": 1e3 * self.sigma,
            "sigma_along_mm": 1e3 * self.sigma_along,
            "sigma_across_mm": 1e3 * self.sigma_across,
            "in_front_mm": 1e3 * self.in_front_by,
            "miss_px": self.miss,
            "chi_square": self.chi_square,
        }


def locate_in_mirror(
    rig: MirrorRig, pixels: ArrayLike, pixel_sigma: float = 1.0
) -> tuple[MirrorLocation, ...]:
    """Find things from the pixels of their reflections.

    The depth is that of stereo at the distance of the reflection: 15 mm at half a metre for 0.3 px,
    however well the mirror is known. Across the line of sight it is some millimetres.

    Four pixel coordinates tell three of a place; the fourth tells whether the two lines of sight
    meet. Where they pass each other by more than is to be expected, the covariance grows with the
    square of that (Birge's ratio), and far beyond it there is no place to tell.

    Args:
        pixels: Left u, v and right u, v of each reflection [px]. Shape (N, 4).
        pixel_sigma: Standard deviation of a pixel coordinate [px].

    Returns:
        One place each.

    Raises:
        ModelError: If pixels are no reflection: their sights meet in front of the glass or behind
            the cameras, or pass each other.
        ValueError: If the shape is wrong or a pixel is not finite.
    """
    pixels = np.asarray(pixels, dtype=float)
    if pixels.ndim != 2 or pixels.shape[1] != 4 or not np.isfinite(pixels).all():
        raise ValueError(f"pixels must be finite and have shape (N, 4), got {pixels.shape}")
    found = rig.triangulate(pixels, pixel_sigma)
    if not found.in_front.all():
        row = int(np.flatnonzero(~found.in_front)[0])
        raise ModelError(
            f"pixels {', '.join(f'{v:g}' for v in pixels[row])} are no reflection in this mirror: "
            "the two lines of sight do not meet behind the glass; is the thing seen directly, or "
            "are left and right exchanged?"
        )
    sights = found.p_WQ - rig.virtual.left.X_WC[:3, 3]
    sights /= np.linalg.norm(sights, axis=1, keepdims=True)
    room = rig.plane.distance_to(found.p_WQ)
    squares = np.sum(found.residuals**2, axis=1)
    chi_square = squares / (pixel_sigma**2 + _LEFT_OUT**2)
    _require_meeting(pixels, squares, chi_square, pixel_sigma)
    covariance = found.covariance * np.maximum(chi_square, 1.0)[:, None, None]
    miss = np.sqrt(squares / 2.0)
    columns = (sights, miss.tolist(), chi_square.tolist(), room.tolist())
    rows = zip(found.p_WQ, covariance, *columns, strict=True)
    return tuple(MirrorLocation(*row) for row in rows)


def _require_meeting(
    pixels: NDArray, squares: NDArray, chi_square: NDArray, pixel_sigma: float
) -> None:
    """Refuse pixels whose lines of sight pass each other.

    Raises:
        ModelError: Naming the pixels.
    """
    row = int(np.argmax(chi_square)) if len(chi_square) else 0
    if len(chi_square) and chi_square[row] > _LARGEST_CHI_SQUARE:
        raise ModelError(
            f"pixels {', '.join(f'{v:g}' for v in pixels[row])} are not of one thing in this "
            f"mirror: the two lines of sight pass each other by {np.sqrt(squares[row]):.1f} px, "
            f"where {np.hypot(pixel_sigma, _LEFT_OUT):.2f} px are to be expected; is it the same "
            "thing in both images, is the mirror flat, is a pixel known as well as "
            "--pixel-sigma says?"
        )
