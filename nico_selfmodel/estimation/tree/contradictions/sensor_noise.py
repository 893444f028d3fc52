"""Noise of sensors and joints that is none, or far less than was stated."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA, FIRST_SIGMA, POSES, SIGHTS
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_JOINT_NOISE, LARGEST_NOISE
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import spread_of
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.model.tree.body_tree import REVOLUTE
from nico_selfmodel.names import listed

_MISFIT = 5.0
"""Times the stated sigma of a sensor beyond which the body does not explain what it measured."""
_LOOSE = 10.0
"""Times less than the stated sigma from which on that is doubted."""
LARGEST_TURN_NOISE = np.radians(15.0)
"""Noise of turns above this is none [rad]."""
_ADVICE = (
    "check units, lenses, which link each marker is on, that readings and what was seen are of the "
    "same moments, and whether something moved during the recording"
)
CHECK_TOUCHES = (
    "check which marker touched what, whether that moved in between (each place is a sensor of its "
    "own), and the readings of these poses"
)
"""What is to be done where touches are missed."""


def sensor_misfits(calibration: TreeCalibration) -> list[str]:
    """Say which sensors' residuals are far beyond the noise that they are said to have."""
    return [
        f"what sensor {name!r} measured is off by {found}, it is "
        + (
            f"said to be sure to {sigma}: {_ADVICE}"
            if stated
            else f"taken to be sure to {sigma}: {CHECK_TOUCHES}, or state its `sigma_m`"
        )
        for name, found, sigma, ratio, stated in _beside_sigmas(calibration)
        if ratio > _MISFIT
    ]


def loose_sigmas(calibration: TreeCalibration) -> list[str]:
    """Say which sensors measure far better than they are said to."""
    return [
        f"what sensor {name!r} measured scatters by {found}, it is said to be sure to {sigma}: is "
        "the unit of its sigma right?"
        for name, found, sigma, ratio, stated in _beside_sigmas(calibration)
        if stated and ratio * _LOOSE < 1.0
    ]


def _beside_sigmas(calibration: TreeCalibration) -> Iterator[tuple[str, str, str, float, bool]]:
    """Yield name, noise found, noise stated or taken, their ratio, and whether it is stated."""
    solution, seen = calibration.solution, calibration.train.observations
    for rows in seen.sensors if solution.variances_known else ():
        info, group = calibration.data.sensors[rows.sensor], seen.noise_group[rows.first]
        held = bool(seen.sigma_held[group])
        if info.sigma is None and not held:
            continue
        sigma = FIRST_SIGMA[rows.kind] if info.sigma is None else info.sigma
        found = float(solution.noise.sensor[group])
        if held:  # nobody asked what it is
            found *= _rms(solution.white_by_scalar(seen)[rows.scalars])
        unit, scale = ("px", 1.0) if rows.kind == CAMERA else ("mm", 1e3)
        off, taken = (f"{scale * one:.3g} {unit}" for one in (found, sigma))
        yield info.name, off, taken, found / sigma, info.sigma is not None


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
    return [
        f"what sensor {name} saw would have to be off by {off}: the body does not explain it; "
        f"{_ADVICE}"
    ]


def _unexplained(calibration: TreeCalibration) -> Iterator[tuple[str, str, int]]:
    """Yield name, noise in words and number of scalars of sensors that tell nothing."""
    solution, observations = calibration.solution, calibration.train.observations
    for rows in observations.sensors if solution.variances_known else ():
        if rows.kind not in SIGHTS:
            continue
        noise = solution.noise.sensor[observations.noise_group[rows.first :][:6]]
        seen = spread_of(rows)
        unit, scale = ("px", 1.0) if rows.kind == CAMERA else ("mm", 1e3)
        words = []
        if noise[0] > LARGEST_NOISE * seen:
            words.append(f"{scale * noise[0]:.3g} {unit} in what spreads by {scale * seen:.3g}")
        if rows.kind == POSES and noise[3] > LARGEST_TURN_NOISE:
            words.append(f"{np.degrees(noise[3]):.3g} deg")
        if words:
            where = f" in mirror {rows.mirror!r}" if rows.mirror else ""
            yield f"{rows.name!r}{where}", " and ".join(words), rows.measured.size


def noisy_joints(calibration: TreeCalibration) -> dict[str, float]:
    """Return joints that turn and whose noise would be none, with it [rad]."""
    joints, noise = calibration.data.joints, calibration.solution.noise.joint.tolist()
    both = zip(calibration.train.observations.noisy_joints, noise, strict=True)
    return {
        joints[i].name: sigma
        for (i, _), sigma in both
        if joints[i].motion == REVOLUTE and sigma > LARGEST_JOINT_NOISE
    }


def unexplained_scalars(calibration: TreeCalibration) -> int:
    """Return how many numbers the body does not explain; noisy joints count once a pose."""
    poses = len(calibration.solution.slipped)
    seen = sum(scalars for _, _, scalars in _unexplained(calibration))
    return seen + poses * len(noisy_joints(calibration))
