"""What speaks for and against mirrors, and what their data cannot support."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.diagnosis.flatness import bent_reasons
from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration
from nico_selfmodel.estimation.results.calibration_result import (
    FAILURE,
    NOTE,
    WARNING,
    Finding,
    findings,
)
from nico_selfmodel.estimation.results.verdict import Verdict
from nico_selfmodel.model.self_model import MIRROR_FAILURES

_LARGEST_RATIO = 5.0
"""Residuals above this many expected sigmas say that something else is wrong."""
_GRAZING = np.radians(5.0)
"""Lines of sight that meet the glass at less than this see it edge-on."""
_ONE_POINT = 0.01
"""Poses whose points lie within this rms distance of their mean are one point [m]."""


def mirror_findings(calibration: MirrorCalibration) -> tuple[Finding, ...]:
    """Return what speaks for and against mirrors beyond what every calibration is asked."""
    change = calibration.change
    moved = None if change is None else change.reason
    failures = [
        # A mirror at two places is flat at neither.
        *([moved] if moved else bent_reasons(calibration.flatness)),
        *_behind_reasons(calibration),
        *_grazing_reasons(calibration),
        _misfit_reason(calibration),
    ]
    said = []
    if calibration.test is not None:
        found = calibration.test.pixel_statistics
        said = [f"{found.mean:.2f} px mean error on {found.n} held-out reflections"]
    return (
        *findings(FAILURE, failures),
        *findings(WARNING, _warnings(calibration)),
        *findings(NOTE, said),
    )


def judged(calibration: MirrorCalibration, verdict: Verdict) -> MirrorCalibration:
    """Return a calibration whose self-model says which of its mirrors failed, and why."""
    model, names = calibration.model, tuple(calibration.mirrors)
    known = model.fit.get(MIRROR_FAILURES) or {}
    failures = {name: reason for name, reason in known.items() if name not in names}
    if verdict.status == "FAIL":
        for name in names:
            # A reason that names other mirrors alone is none against this one.
            others = [f"mirror {other!r}" for other in names if other != name]
            own = [
                reason
                for reason in verdict.reasons
                if f"mirror {name!r}" in reason or not any(other in reason for other in others)
            ]
            failures |= {name: own[0]} if own else {}
    fit = {key: value for key, value in model.fit.items() if key != MIRROR_FAILURES}
    fit |= {MIRROR_FAILURES: failures} if failures else {}
    return replace(calibration, model=replace(model, fit=fit))


def _warnings(calibration: MirrorCalibration) -> tuple[str, ...]:
    """Say in words what the data cannot support, though nothing fails."""
    solution, change = calibration.solution, calibration.change
    words = [change.warning] if change is not None and change.warning else []
    for m, (name, mirror) in enumerate(calibration.mirrors.items()):
        rows = (solution.reflections.mirror == m) & ~solution.outliers
        points = solution.reflections.p_LQ[rows]
        poses = len(np.unique(solution.reflections.pose[rows]))
        spread = float(np.sqrt(np.sum(np.var(points, axis=0)))) if len(points) else 0.0
        tilt = np.degrees(mirror.normal_sigma or 0.0)
        known = f"its normal is known to {tilt:.2f} deg"
        if poses == 1:
            words.append(f"mirror {name!r} rests on one pose: {known}; record ten")
        elif spread < _ONE_POINT:
            words.append(
                f"all {poses} poses in mirror {name!r} have the hand within {1e3 * spread:.0f} mm "
                f"of one point: {known}; spread the poses"
            )
        if calibration.flatness[name] is None:
            words.append(f"too few poses to test whether mirror {name!r} is flat: record ten")
    if solution.reflections.shared is None:
        words.append(
            "the self-model has no covariance: what the arm and the cameras are uncertain by is "
            "missing from the mirrors' sigmas"
        )
    elif not solution.reflections.shared.camera_columns:
        words.append(
            "the self-model does not say what its cameras are uncertain by, they count as exact: "
            "`nico-selfmodel calibrate body` would tell"
        )
    if len(calibration.misplaced):
        listed = ", ".join(str(sample) for sample in calibration.misplaced[:8].tolist())
        words.append(
            f"{len(calibration.misplaced)} samples without a mirror's name are reflections in a "
            f"mirror that was learned ({listed}): write its name into the column `mirror`"
        )
    return tuple(words)


def grazing_angles(calibration: MirrorCalibration) -> NDArray:
    """Return at what angle the left camera's line of sight meets the glass [rad]. (N,)."""
    reflections = calibration.solution.reflections
    angles = np.empty(len(reflections))
    for m, mirror in enumerate(calibration.solution.mirrors):
        rows = reflections.mirror == m
        sight = mirror.reflect(reflections.p_LQ[rows])
        angles[rows] = np.arcsin(np.abs(sight @ mirror.normal) / np.linalg.norm(sight, axis=1))
    return angles


def _behind_reasons(calibration: MirrorCalibration) -> list[str]:
    """Name mirrors behind which the body puts its hand, where no reflection can be."""
    solution, reasons = calibration.solution, []
    behind = (solution.in_front_by <= 0.0) & ~solution.outliers
    for m, name in enumerate(solution.reflections.mirrors):
        rows = behind & (solution.reflections.mirror == m)
        if rows.any():
            reasons.append(
                f"{np.unique(solution.reflections.pose[rows]).size} poses put the hand up to "
                f"{-1e3 * solution.in_front_by[rows].min():.0f} mm behind mirror {name!r}, where "
                "it has no reflection: the arm or the cameras are not what the self-model says"
            )
    return reasons


def _grazing_reasons(calibration: MirrorCalibration) -> list[str]:
    angles, reflections = grazing_angles(calibration), calibration.solution.reflections
    return [
        f"mirror {name!r} is seen edge-on: lines of sight meet it at "
        f"{np.degrees(np.median(angles[reflections.mirror == m])):.1f} deg; turn it to the cameras"
        for m, name in enumerate(reflections.mirrors)
        if np.median(angles[reflections.mirror == m]) < _GRAZING
    ]


def _misfit_reason(calibration: MirrorCalibration) -> str | None:
    ratio = float(np.sqrt(calibration.solution.uncertainty.variance_factor))
    if ratio <= _LARGEST_RATIO:
        return None
    return (
        f"the reflections miss their plane by {ratio:.0f} times what pixel noise, joint noise and "
        "the arm's own uncertainty explain: do arm and cameras still fit the robot?"
    )
