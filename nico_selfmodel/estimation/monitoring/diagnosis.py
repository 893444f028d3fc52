"""What changed in a body that no longer fits: one change at a time, the likeliest first.

A generalised likelihood ratio for each hypothesis (Willsky and Jones 1976): each joint's zero and
gear, each tracked point, the arm's base, each camera. Where two say the same, the simpler one is
named: a point moved about the last axis is that joint's slip, and nothing could tell them apart.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.monitoring.change_likelihood import ChangeEstimate, ChangeLikelihood
from nico_selfmodel.estimation.monitoring.monitored_changes import RIGHT_POSE, left_camera
from nico_selfmodel.estimation.noise.pose_residuals import PoseResiduals
from nico_selfmodel.geometry.rotation import slope_together
from nico_selfmodel.model.arm.dh_parameters import M0_NAMES
from nico_selfmodel.model.noise_mixture import NoiseMixture
from nico_selfmodel.model.self_model import SelfModel

PENALTY = 7.0
"""What a further parameter must bring: chance does once in 100."""
_ALIKE = 5e-3
"""Or this share of what the best explanation brings: explanations of a large change differ by what
the model leaves out, which is no chance."""


_THE_SAME = 1e-6
"""Share by which statistics of one change under two names differ: that of rounding."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One thing that may have changed."""

    cause: str
    """In words: `zero of right_elbow`."""
    names: tuple[str, ...]
    """Parameters to learn anew if it did."""
    basis: NDArray
    """Directions of change among all parameters. Shape (P, m)."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """How well one change explains what was seen."""

    hypothesis: Hypothesis
    """The change."""
    statistic: float
    """Twice the logarithm of the likelihood ratio, chi-square of `dof` if nothing changed."""
    dof: int
    """Parameters of the change that the poses show."""
    score: float
    """`statistic` less what each parameter must bring: the largest wins."""
    change: NDArray
    """Most likely change along the basis. Shape (d,)."""
    sigma: NDArray
    """Standard deviation of `change`. Shape (d,)."""
    of_pose: NDArray
    """What each pose says for having been taken after the change, the logarithm of a likelihood
    ratio. Shape (N,)."""


def ranked_causes(
    poses: PoseResiduals,
    noise: NoiseMixture,
    covariance: NDArray,
    causes: Iterable[Hypothesis],
    since: int,
) -> tuple[Diagnosis, ...]:
    """Rank what may have changed by how well it explains the poses, of whatever body.

    Args:
        poses: Before and after the change; those before tell the model's own errors.
        covariance: Of the poses' parameters. Shape (P, P).
        causes: What may have changed.
        since: First pose after the change.

    Returns:
        Explanations, the best first.
    """
    likelihood = ChangeLikelihood(poses, noise, covariance)
    unchanged = likelihood.of(np.zeros((len(poses.names), 0)), since).log_likelihood
    return ranked(
        diagnosed(hypothesis, likelihood.of(hypothesis.basis, since), unchanged)
        for hypothesis in causes
    )


def diagnosed(hypothesis: Hypothesis, found: ChangeEstimate, unchanged: float) -> Diagnosis:
    """Return what a change explains, not yet held against others.

    Args:
        found: Its most likely size.
        unchanged: Logarithm of the likelihood of no change.
    """
    statistic = 2.0 * (found.log_likelihood - unchanged)
    return Diagnosis(
        hypothesis, statistic, found.dof, statistic, found.change, found.sigma, found.of_pose
    )


def ranked(diagnoses: Iterable[Diagnosis]) -> tuple[Diagnosis, ...]:
    """Return explanations with their scores, the best first."""
    found = tuple(diagnoses)
    penalty = max(PENALTY, _ALIKE * max(d.statistic for d in found))
    scored = (replace(d, score=d.statistic - d.dof * penalty) for d in found)
    return tuple(sorted(scored, key=lambda d: -d.score))


def alike_to(one: Diagnosis, other: Diagnosis) -> bool:
    """Return whether two explanations of as many parameters are the same to all that was seen."""
    near = abs(one.statistic - other.statistic) < _THE_SAME * max(one.statistic, 1.0)
    return one.dof == other.dof and bool(near)


def hypotheses(model: SelfModel, names: tuple[str, ...]) -> tuple[Hypothesis, ...]:
    """Return what may change: each zero, each gear, each tracked point, the cameras.

    Args:
        names: Parameters that the observations depend on.
    """
    found = [simple_hypothesis(f"zero of {j}", (f"{j}.theta_offset",), names) for j in model.joints]
    found += [_gear(joint, names) for joint in model.joints]
    for marker in model.markers:
        own = tuple(f"hand.{marker}.{axis}" for axis in "xyz")
        found.append(simple_hypothesis(f"point {marker} on the hand", own, names))
    if len(model.markers) > 1:
        found.append(_hand(model, names))
    seen = set(RIGHT_POSE) <= set(names)
    what = f"base of the arm against the {'cameras' if seen else 'tracker'}"
    found.append(simple_hypothesis(what, M0_NAMES, names))
    if seen:
        found.append(simple_hypothesis("pose of the right camera", RIGHT_POSE, names))
        both = (*M0_NAMES, *RIGHT_POSE)
        left = left_camera(model, names)
        found.append(Hypothesis("pose of the left camera", both, left))
    return tuple(found)


def simple_hypothesis(cause: str, own: tuple[str, ...], names: tuple[str, ...]) -> Hypothesis:
    """Return that some parameters changed, each by itself.

    Args:
        own: Names of what changed.
        names: Of all parameters.
    """
    basis = np.zeros((len(names), len(own)))
    basis[[names.index(name) for name in own], np.arange(len(own))] = 1.0
    return Hypothesis(cause, own, basis)


def _hand(model: SelfModel, names: tuple[str, ...]) -> Hypothesis:
    """All points move together: what carries them sits otherwise."""
    own = tuple(f"hand.{marker}.{axis}" for marker in model.markers for axis in "xyz")
    basis = np.zeros((len(names), 6))
    basis[[names.index(name) for name in own]] = slope_together(model.dh.p_NH).reshape(-1, 6)
    return Hypothesis("all points on the hand together", own, basis)


def _gear(joint: str, names: tuple[str, ...]) -> Hypothesis:
    """A gear changes about the zero at which it was mounted: both of its numbers move."""
    own = (f"{joint}.gear", f"{joint}.theta_offset")
    return simple_hypothesis(f"gear of {joint}", own, names)
