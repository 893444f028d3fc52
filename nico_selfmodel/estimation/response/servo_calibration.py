"""How joints follow their commands, learned from steps, each number with its standard deviation."""

import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.response.step_fit import StepFit, fit_steps, refit
from nico_selfmodel.estimation.response.steps import FEWEST_STEPS, Steps, steps_of
from nico_selfmodel.estimation.results.folds import fold_of, splits
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.model.response.servo_response import ServoResponse, ServoResponses
from nico_selfmodel.model.response.step_response import PARTS
from nico_selfmodel.model.self_model import ParameterCovariance

_FOLDS = 20
"""Groups of steps that are left out in turn."""
_STUCK = 0.2
"""Share of the way it is told below which a joint does not move."""
_OUTLIER = 6.0
"""A step whose residual is this many times the median one contradicts the rest."""
_NOTABLE = 0.02
"""And this share of its way."""


@dataclass(frozen=True, eq=False)
class JointResponse:
    """The response of one joint, and what it was learned from."""

    steps: Steps
    """All of its steps."""
    outliers: NDArray
    """Steps that contradict the rest. Boolean, shape (n,)."""
    fit: StepFit
    """Of the others."""
    response: ServoResponse
    """What was learned."""
    covariance: NDArray
    """Of delay and the numbers that the response has, in the order of `PARTS`."""
    left_out: NDArray
    """Residual of each row by what was learned without its step, of all steps but outliers; nan of
    these [rad]. Shape (N,)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for key in ("outliers", "covariance", "left_out"):
            object.__setattr__(self, key, read_only(getattr(self, key)))

    @property
    def fitted(self) -> NDArray:
        """Residuals of what was learned from, all with one delay [rad]."""
        return residuals_of(self.steps.select(~self.outliers), self.response)

    @property
    def names(self) -> tuple[str, ...]:
        """What the covariance is of: `<joint>.<part>`."""
        return tuple(
            f"{self.steps.joint}.{part}" for part in PARTS[:1] + tuple(self.response.parts)
        )

    @property
    def unexplained(self) -> float:
        """What is left unexplained, each step with its own delay: rms, as a share of the ways'."""
        way = np.abs(self.steps.way[~self.outliers])
        return float(np.sqrt(np.mean(self.fit.residuals**2)) / np.sqrt(np.mean(way**2)))

    @property
    def overshoot(self) -> float:
        """How far a step goes beyond where it ends, as a share of the way: the median."""
        rest = self.steps.select(~self.outliers)
        farthest = np.zeros(len(rest))
        np.maximum.at(farthest, rest.step, rest.gone)
        return float(np.median(farthest / np.abs(rest.way)) - 1.0)


@dataclass(frozen=True, eq=False)
class ServoCalibration:
    """Responses of the joints of a robot, with all that they are judged by."""

    model: ServoResponses
    """What was learned."""
    joints: tuple[JointResponse, ...]
    """Of each joint that was told to move."""
    train: MotionRecording
    """What was learned from."""
    test: tuple[tuple[Steps, NDArray], ...] | None
    """Held-out steps of each joint, and residuals of their rows [rad]; None without any."""
    refused: tuple[str, ...]
    """What is wrong with joints that have no response, in words."""
    seconds: float
    """Time taken."""


def calibrate_servos(
    train: MotionRecording,
    test: MotionRecording | None = None,
    *,
    fraction: float = 0.0,
    seed: int = 0,
    name: str | None = None,
) -> ServoCalibration:
    """Learn how joints follow their commands from steps.

    A step is a command that changes at once and then stays until the joint rests. Standard
    deviations are those of a jackknife over steps, which holds whatever differs from step to step
    (Quenouille 1956).

    Args:
        train: Commands and readings.
        test: Held-out ones of the same joints.
        fraction: Share of each joint's steps to hold out, where there is no `test`.
        seed: Of the draw of these.
        name: Of the robot; the recording's if omitted.

    Raises:
        NotIdentifiableError: If no joint has steps that tell its response.
        ValueError: If the recordings are of different joints.
    """
    began = time.perf_counter()
    if test is not None and [j.name for j in test.joints] != [j.name for j in train.joints]:
        raise ValueError("the held-out recording is of other joints")
    found, refused, held = [], [], []
    rng = np.random.default_rng(seed)
    for k in range(len(train.joints)):
        steps = steps_of(train, k)
        if steps is None:
            continue
        wrong = why_it_does_not_follow(train, k, steps)
        if wrong is not None:
            refused.append(wrong)
            continue
        left = _drawn(len(steps), fraction, rng)
        found.append(_response_of(steps.select(~left)))
        held.append(steps.select(left))
    if not found and not refused:
        raise NotIdentifiableError(
            "no command of any joint changes: nothing tells how joints follow them"
        )
    names = tuple(one for joint in found for one in joint.names)
    model = ServoResponses(
        train.name if name is None else name,
        tuple(joint.response for joint in found),
        ParameterCovariance(names, _blocks([joint.covariance for joint in found])),
        {
            "dataset": train.name,
            "dataset_sha256": train.content_hash,
            "versions": package_versions(),
        },
    )
    if test is not None:
        held = [steps_of(test, k) for k in range(len(test.joints))]
    held_out = None if test is None and not fraction else _held_out(held, model)
    took = time.perf_counter() - began
    return ServoCalibration(model, tuple(found), train, held_out, tuple(refused), took)


def why_it_does_not_follow(recording: MotionRecording, joint: int, steps: Steps) -> str | None:
    """Say in which way a joint does not go where it is told; None where it does.

    Args:
        recording: Commands and readings of all joints.
        joint: Number of the joint.
        steps: Its steps.
    """
    ratio = float(np.median(steps.way / steps.told))
    told = np.degrees(np.median(np.abs(steps.told)))
    if abs(ratio) < _STUCK:
        other = _moved_instead(recording, joint, steps)
        if other is not None:
            return (
                f"{steps.joint} is told to move and {other} moves: are their encoders, or their "
                "commands, exchanged?"
            )
        return (
            f"{steps.joint} does not move: told to go by {told:.3g} deg it goes by "
            f"{told * abs(ratio):.2g}; is its servo on, and does anything hold it?"
        )
    if ratio < 0.0:
        return (
            f"{steps.joint} goes the other way than it is told: one of command and encoder counts "
            "the other way"
        )
    if not 0.9 < ratio < 1.0 / 0.9:
        return (
            f"{steps.joint} goes {ratio:.3g} times as far as it is told: are command and encoder "
            "in one unit, and is counts_per_turn right?"
        )
    return None


def _moved_instead(recording: MotionRecording, joint: int, steps: Steps) -> str | None:
    """Return the joint whose reading changes where another was told to move, None for none."""
    rows = np.searchsorted(recording.time, steps.begins)
    ends = np.append(rows[1:], len(recording.time))
    told = np.median(np.abs(steps.told))
    for k, info in enumerate(recording.joints):
        still = all(
            recording.commanded[row, k] == recording.commanded[row - 1, k] for row in rows.tolist()
        )
        if k == joint or not still:
            continue
        size = info.radians_per_unit
        moved = [
            size * _range(recording.encoders[row:end, k])
            for row, end in zip(rows.tolist(), ends.tolist(), strict=True)
        ]
        if np.median(moved) > _STUCK * told:
            return info.name
    return None


def _range(readings: NDArray) -> float:
    known = readings[np.isfinite(readings)]
    return float(np.ptp(known)) if len(known) else 0.0


def _response_of(steps: Steps) -> JointResponse:
    """Fit a response, set aside steps that contradict the rest, and find its covariance."""
    outliers = np.abs(steps.way) < _STUCK * np.abs(steps.told)
    fit, rest = fit_steps(steps.select(~outliers))
    further = _contradicting(rest, fit.residuals)
    if further.any() and (~further).sum() >= FEWEST_STEPS:
        outliers[~outliers] = further
        fit, rest = fit_steps(steps.select(~outliers))
    covariance, left_out = _jackknife(rest, fit)
    everywhere = np.full(len(steps.gone), np.nan)
    everywhere[~outliers[steps.step]] = left_out
    return JointResponse(steps, outliers, fit, fit.response(steps.joint), covariance, everywhere)


def _contradicting(steps: Steps, residuals: NDArray) -> NDArray:
    """Return which steps fit far worse than the others. Boolean, shape (n,)."""
    off = step_rms(steps, residuals)
    limit = np.maximum(_OUTLIER * np.median(off), _NOTABLE * np.abs(steps.way))
    return off > limit


def step_rms(steps: Steps, residuals: NDArray) -> NDArray:
    """Return the root mean square of each step's residuals [rad]. Shape (n,)."""
    n = len(steps)
    count = np.bincount(steps.step, minlength=n)
    return np.sqrt(np.bincount(steps.step, residuals**2, n) / np.maximum(count, 1))


def _jackknife(steps: Steps, fit: StepFit) -> tuple[NDArray, NDArray]:
    """Return the covariance of delay and parts, and residuals of steps that were left out.

    With g groups left out in turn, var = (g - 1) / g sum (x_i - mean x)^2. It is known from g
    groups alone: times (g - 1) / (g - 3), errors over sigma have a mean square of 1 (as Student's t
    of g - 1 degrees of freedom).
    """
    fold = fold_of(np.arange(len(steps)), _FOLDS)
    found, left_out = [], np.full(len(steps.gone), np.nan)
    for part in splits(fold):
        without = refit(steps, fit, part.rest)
        found.append([without.delays.mean(), *without.log_parts])
        rows = part.left[steps.step]
        left_out[rows] = residuals_of(steps, without.response(steps.joint))[rows]
    off = np.array(found) - np.mean(found, axis=0)
    g = len(found)
    scale = np.array([1.0, *np.exp(fit.log_parts)])
    few = (g - 1) / (g - 3)
    return few * (g - 1) / g * (off.T @ off) * np.outer(scale, scale), left_out


def residuals_of(steps: Steps, response: ServoResponse) -> NDArray:
    """Return measured less expected of each row, all with one delay [rad]. Shape (N,)."""
    return steps.gone - response.after(np.abs(steps.way)[steps.step], steps.time)


def _drawn(count: int, fraction: float, rng: np.random.Generator) -> NDArray:
    """Return which steps are held out: a share, of which enough are left to learn from. (n,)."""
    most = max(count - FEWEST_STEPS, 0)
    held = np.zeros(count, dtype=bool)
    held[rng.permutation(count)[: min(round(fraction * count), most)]] = True
    return held


def _held_out(
    held: Iterable[Steps | None], model: ServoResponses
) -> tuple[tuple[Steps, NDArray], ...]:
    """Return held-out steps of joints that have a response, and their residuals."""
    known = {response.joint: response for response in model.joints}
    return tuple(
        (steps, residuals_of(steps, known[steps.joint]))
        for steps in held
        if steps is not None and len(steps) and steps.joint in known
    )


def _blocks(matrices: list[NDArray]) -> NDArray:
    """Return matrices along a diagonal."""
    sizes = [len(matrix) for matrix in matrices]
    out = np.zeros((sum(sizes), sum(sizes)))
    for end, matrix in zip(np.cumsum(sizes).tolist(), matrices, strict=True):
        out[end - len(matrix) : end, end - len(matrix) : end] = matrix
    return out
