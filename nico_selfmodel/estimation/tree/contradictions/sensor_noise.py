"""Noise of sensors and joints that is none, or far less than was stated."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA, FIRST_SIGMA, POSES, SIGHTS
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_NOISE
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import spread_of
from nico_selfmodel.estimation.tree.contradictions.ran_away import noisy_joints
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.names import listed

_MISFIT = 5.0
"""Times the stated sigma of a sensor beyond which the body does not explain what it measured."""
_LOOSE = 10.0
"""Times less than the stated sigma from which on that is doubted."""
_LEFT_OVER = 4.0
"""Numbers that fitting must have left over to tell: noise of four looks so once in 5,000."""
LARGEST_TURN_NOISE = np.radians(15.0)
"""Noise of turns above this is none [rad]."""
_ADVICE = (
    "check units, lenses, which link each marker is on, that readings and what was seen are of the "
    "same moments, and whether something moved during the recording"
)
_TURNS_ADVICE = (
    "check how turns are written (rx, ry, rz: axis times angle in radians; qw: the quaternion's "
    "real part) and which way they go (of the marker in the sensor, not the inverse)"
)
CHECK_TOUCHES = (
    "check which marker touched what, whether that moved in between (each place is a sensor of its "
    "own), and the readings of these poses"
)
"""What is to be done where touches are missed."""


def sensor_misfits(calibration: TreeCalibration) -> list[str]:
    """Say which sensors' residuals are far beyond the noise that they are said to have."""
    return [
        f"what sensor {one.name!r} measured is off by {one.length(one.off)}, it is "
        + (
            f"said to be sure to {one.length(one.sigma)}: {_ADVICE}"
            if one.stated
            else f"taken to be sure to {one.length(one.sigma)}: {CHECK_TOUCHES}, or state its "
            "`sigma_m`"
        )
        for one in _beside_sigmas(calibration)
        if one.off > _MISFIT * one.sigma
    ]


def loose_sigmas(calibration: TreeCalibration) -> list[str]:
    """Say which sensors measure far better than they are said to."""
    return [
        f"what sensor {one.name!r} measured scatters by {one.length(one.scatter)}, it is said to "
        f"be sure to {one.length(one.sigma)}: is the unit of its sigma right?"
        for one in _beside_sigmas(calibration)
        if one.stated and one.scatter * _LOOSE < one.sigma
    ]


@dataclass(frozen=True)
class _BesideSigma:
    """What a sensor leaves, beside the noise that it is said or taken to have [m, rad or px]."""

    name: str
    off: float
    """What is left of what it measured, root mean square."""
    scatter: float
    """That with what fitting took of it; inf where too little is left over to tell."""
    sigma: float
    stated: bool
    in_pixels: bool

    def length(self, value: float) -> str:
        return f"{value:.3g} px" if self.in_pixels else f"{1e3 * value:.3g} mm"


def _beside_sigmas(calibration: TreeCalibration) -> Iterator[_BesideSigma]:
    """Yield what sensors leave whose noise is stated, or taken for known."""
    solution, seen = calibration.solution, calibration.train.observations
    for rows in seen.sensors if solution.variances_known else ():
        info, group = calibration.data.sensors[rows.sensor], seen.noise_group[rows.first]
        held = bool(seen.sigma_held[group])
        if info.sigma is None and not held:
            continue
        sigma, stated = info.sigma, info.sigma is not None
        off = scatter = _rms(solution.noise.sensor[seen.noise_group[rows.scalars][:3]])
        if held:  # nobody asked what it is
            white = solution.white_by_scalar(seen)
            off *= _rms(white[rows.scalars])
            counts = np.isfinite(white)
            scatter = (
                off * fitted_away(solution.whitened, counts, rows.scalars) if stated else np.inf
            )
        sigma = FIRST_SIGMA[rows.kind] if sigma is None else sigma
        yield _BesideSigma(info.name, off, scatter, sigma, stated, rows.kind == CAMERA)


def fitted_away(whitened: NDArray, counts: NDArray, scalars: slice) -> float:
    """Return by how much fitting made the residuals of a sensor smaller; inf where it left too few.

    Of n numbers with derivatives A, n - tr A (J'J)^-1 A' are left over.

    Args:
        whitened: Derivatives J of what counts by what was fitted, priors last. Shape (k, free).
        counts: Which numbers count. Boolean, shape (R,).
        scalars: The sensor's own.
    """
    first, n = int(counts[: scalars.start].sum()), int(counts[scalars].sum())
    J = whitened / np.maximum(np.linalg.norm(whitened, axis=0), np.finfo(float).tiny)
    A = J[first : first + n]
    left = n - np.sum(A @ np.linalg.pinv(J.T @ J, rcond=1e-12, hermitian=True) * A)
    return float(np.sqrt(n / left)) if left >= _LEFT_OVER else np.inf


def _rms(white: NDArray) -> float:
    """Return the root mean square of what counts, 1 of nothing."""
    counts = np.isfinite(white)
    return float(np.sqrt(np.mean(white[counts] ** 2))) if counts.any() else 1.0


def unexplained_sensors(calibration: TreeCalibration) -> list[str]:
    """Say which sensors would have to be so noisy that what they saw tells nothing."""
    found = [(name, words) for name, words, _ in _unexplained(calibration)]
    if not found:
        return []
    if len(found) > 1:
        off = listed([f"{name} ({words})" for name, words in found])
        return [f"the body does not explain what sensors saw, by {off}; {_ADVICE}"]
    ((name, off),) = found
    advice = _ADVICE if " in what spreads by " in off else f"{_TURNS_ADVICE}; else {_ADVICE}"
    return [
        f"what sensor {name} saw would have to be off by {off}: the body does not explain it; "
        f"{advice}"
    ]


def _unexplained(calibration: TreeCalibration) -> Iterator[tuple[str, str, int]]:
    """Yield name, noise in words and number of scalars of sensors that tell nothing."""
    solution, observations = calibration.solution, calibration.train.observations
    for rows in observations.sensors if solution.variances_known else ():
        if rows.kind not in SIGHTS:
            continue
        noise = solution.noise.sensor[observations.noise_group[rows.scalars][:6]]
        seen = spread_of(rows)
        unit, scale = ("px", 1.0) if rows.kind == CAMERA else ("mm", 1e3)
        words = []
        place = _rms(noise[:3])
        if place > LARGEST_NOISE * seen:
            words.append(f"{scale * place:.3g} {unit} in what spreads by {scale * seen:.3g}")
        turn = _rms(noise[3:]) if rows.kind == POSES else 0.0
        if turn > LARGEST_TURN_NOISE:
            words.append(f"{np.degrees(turn):.3g} deg")
        if words:
            where = f" in mirror {rows.mirror!r}" if rows.mirror else ""
            yield f"{rows.name!r}{where}", " and ".join(words), rows.measured.size


def unexplained_scalars(calibration: TreeCalibration) -> int:
    """Return how many numbers the body does not explain; noisy joints count once a pose."""
    poses = len(calibration.solution.slipped)
    seen = sum(scalars for _, _, scalars in _unexplained(calibration))
    return seen + poses * len(noisy_joints(calibration.train.observations, calibration.solution))
