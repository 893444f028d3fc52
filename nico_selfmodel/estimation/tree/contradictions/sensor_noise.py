"""Noise of sensors that is none, or far less than was stated."""

from collections.abc import Iterator

import numpy as np

from nico_selfmodel.dataset.body.sensors import CAMERA, POSES, SIGHTS
from nico_selfmodel.estimation.noise.hand_noise import LARGEST_NOISE
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration

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


def sensor_misfits(calibration: TreeCalibration) -> list[str]:
    """Say which sensors' residuals are far beyond the noise that they are said to have.

    Args:
        calibration: What was learned.
    """
    return [
        f"what sensor {name!r} measured is off by {found}, it is said to be sure to {said}: "
        f"{_ADVICE}"
        for name, found, said, ratio in _beside_stated(calibration)
        if ratio > _MISFIT
    ]


def loose_sigmas(calibration: TreeCalibration) -> list[str]:
    """Say which sensors measure far better than they are said to.

    Args:
        calibration: What was learned.
    """
    return [
        f"what sensor {name!r} measured scatters by {found}, it is said to be sure to {stated}: is "
        "the unit of its sigma right?"
        for name, found, stated, ratio in _beside_stated(calibration)
        if ratio * _LOOSE < 1.0
    ]


def _beside_stated(calibration: TreeCalibration) -> list[tuple[str, str, str, float]]:
    """Return name, noise found, noise stated and their ratio of sensors that state one."""
    solution, observations = calibration.solution, calibration.train.observations
    out = []
    for rows in observations.sensors:
        info = calibration.data.sensors[rows.sensor]
        if info.sigma is None or not solution.variances_known:
            continue
        found = float(solution.noise.sensor[observations.noise_group[rows.first]])
        unit, scale = ("px", 1.0) if rows.kind == CAMERA else ("mm", 1e3)
        shown = (f"{scale * sigma:.3g} {unit}" for sigma in (found, info.sigma))
        out.append((info.name, *shown, found / info.sigma))
    return out


def unexplained_sensors(calibration: TreeCalibration) -> Iterator[str]:
    """Say which sensors would have to be so noisy that what they saw tells nothing.

    Args:
        calibration: What was learned.
    """
    solution, observations = calibration.solution, calibration.train.observations
    for rows in observations.sensors if solution.variances_known else ():
        if rows.kind not in SIGHTS:
            continue
        noise = solution.noise.sensor[observations.noise_group[rows.first :][:6]]
        seen = float(np.sqrt(np.sum(np.var(rows.measured[:, :3], axis=0))))
        unit, scale = ("px", 1.0) if rows.kind == CAMERA else ("mm", 1e3)
        words = []
        if noise[0] > LARGEST_NOISE * seen:
            words.append(f"{scale * noise[0]:.3g} {unit} in what spreads by {scale * seen:.3g}")
        if rows.kind == POSES and noise[3] > LARGEST_TURN_NOISE:
            words.append(f"{np.degrees(noise[3]):.3g} deg")
        if words:
            where = f" in mirror {rows.mirror!r}" if rows.mirror else ""
            yield (
                f"what sensor {rows.name!r} saw{where} would have to be off by "
                f"{' and '.join(words)}: the body does not explain it; {_ADVICE}"
            )
