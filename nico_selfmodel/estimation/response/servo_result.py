"""Responses of servos as the result of a calibration."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.response.servo_calibration import (
    JointResponse,
    ServoCalibration,
    step_rms,
)
from nico_selfmodel.estimation.response.steps import Steps
from nico_selfmodel.estimation.results.calibration_result import (
    CAUSE,
    MISFIT,
    WARNING,
    CalibrationResult,
    Errors,
    Finding,
    Parameter,
    Terms,
    findings,
)
from nico_selfmodel.model.response.step_response import PARTS, PROFILE, UNITS

MOST_UNEXPLAINED = 0.05
"""Share of the way that a response may leave unexplained: what is off by more is no such motion."""
MOST_OVERSHOOT = 0.05
"""Share of the way by which a joint may go too far; none of the responses has any."""
EARLY = 3.0
"""Standard deviations by which a delay must be below nothing before clocks are doubted."""
_TERMS = Terms(
    held_out="steps",
    observed="steps",
    outlier_cause="was the joint held, or commanded by something else too?",
    worse_cause="load, speed or sizes of the held-out steps are others, or the servos have changed",
    decisive="deg",
)


def servo_result(calibration: ServoCalibration) -> CalibrationResult:
    """Return responses with all that they are judged by and that is written down of them."""
    joints = calibration.joints
    outliers = [joint.outliers for joint in joints]
    crossed = [(joint.steps.select(~joint.outliers), _kept(joint)) for joint in joints]
    return CalibrationResult(
        method="servos",
        parameters={name: one for joint in joints for name, one in _parameters(joint).items()},
        train=_errors([(joint.steps.select(~joint.outliers), joint.fitted) for joint in joints]),
        test=None if calibration.test is None else _errors(calibration.test),
        cross_validation=_errors(crossed),
        outliers=np.concatenate(outliers) if outliers else np.zeros(0, dtype=bool),
        outlier_names=tuple(
            f"{joint.steps.joint} at {begin:.6g} s"
            for joint in joints
            for begin in joint.steps.begins[joint.outliers].tolist()
        ),
        converged=all(joint.fit.converged for joint in joints),
        iterations=max((joint.fit.iterations for joint in joints), default=0),
        seconds=calibration.seconds,
        findings=(
            *findings(CAUSE, calibration.refused),
            *(one for joint in joints for one in _findings(joint)),
        ),
        details={"responses": {joint.steps.joint: _details(joint) for joint in joints}},
        terms=_TERMS,
    )


def _kept(joint: JointResponse) -> NDArray:
    return joint.left_out[~joint.outliers[joint.steps.step]]


def _errors(parts: "list[tuple[Steps, NDArray]] | tuple[tuple[Steps, NDArray], ...]") -> Errors:
    """Return how far joints are from where they are expected, reading by reading."""
    if not parts:
        return Errors(angles=np.zeros(0), poses=0, unit="deg")
    return Errors(
        angles=np.abs(np.concatenate([residuals for _, residuals in parts])),
        poses=sum(len(steps) for steps, _ in parts),
        compared=np.concatenate([step_rms(*part) for part in parts]),
        unit="deg",
    )


def _parameters(joint: JointResponse) -> dict[str, Parameter]:
    """Return what was learned; what does not show has no value."""
    sigma = dict(zip(joint.names, np.sqrt(np.diag(joint.covariance)).tolist(), strict=True))
    table = {}
    for part in PARTS:
        if part == "acceleration" and joint.response.kind != PROFILE:
            continue
        name = f"{joint.steps.joint}.{part}"
        value = getattr(joint.response, part)
        table[name] = Parameter(value, sigma.get(name), UNITS[part], name in sigma)
    return table


def _details(joint: JointResponse) -> dict[str, Any]:
    response, steps = joint.response, joint.steps
    return {
        "kind": response.kind,
        "steps": len(steps),
        "unused_steps": steps.unused,
        "delay_spread_s": response.delay_spread,
        "unexplained": joint.unexplained,
        "overshoot": joint.overshoot,
        "rests_off_deg": float(np.degrees(np.median(np.abs(steps.missed)))),
        "reading_noise_deg": float(np.degrees(steps.sigma.min())),
    }


def _findings(joint: JointResponse) -> list[Finding]:
    """Return what this joint's response cannot explain, or does not tell."""
    name, response = joint.steps.joint, joint.response
    delay_sigma = float(np.sqrt(joint.covariance[0, 0]))
    early = response.delay < -EARLY * delay_sigma
    share, over = joint.unexplained, joint.overshoot
    causes = [
        f"{name} moves {-response.delay:.3f} s before it is told: the clocks of commands and "
        "readings differ"
        if early
        else None
    ]
    misfits = [
        f"no response explains how {name} moves: {100 * share:.0f} % of its ways are left "
        f"unexplained, at most {100 * MOST_UNEXPLAINED:.0f} % may be; does it stick, swing or hit "
        "something?"
        if share > MOST_UNEXPLAINED
        else None
    ]
    warned = [
        f"{name} goes {100 * over:.0f} % of its way too far before it comes back: no response here "
        "has that; lower its gain, or damp it"
        if over > MOST_OVERSHOOT
        else None,
        _not_reached(joint),
        f"{joint.steps.unused} steps of {name} were not used: they do not begin and end at rest"
        if joint.steps.unused > len(joint.steps)
        else None,
    ]
    return [*findings(CAUSE, causes), *findings(MISFIT, misfits), *findings(WARNING, warned)]


def _not_reached(joint: JointResponse) -> str | None:
    """Say that the largest speed does not show, where it does not."""
    if joint.response.speed is not None:
        return None
    longest = np.degrees(np.abs(joint.steps.way).max())
    return (
        f"{joint.steps.joint} does not reach its largest speed in steps of up to {longest:.0f} "
        "deg: larger ones tell it"
    )
