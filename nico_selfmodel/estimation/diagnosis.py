"""What changed in a body that no longer fits: one change at a time, the likeliest first.

A generalised likelihood ratio for each hypothesis (Willsky and Jones 1976): each joint's zero and
gear, each tracked point, the arm's base, each eye. Where two say the same, the simpler one is
named: a point moved about the last axis is that joint's slip, and nothing could tell them apart.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.sightings import Innovations
from nico_selfmodel.geometry.rotation import rotation_vector_slope, skew
from nico_selfmodel.model.dh_parameters import M0_NAMES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.stereo_rig import POSE_NAMES

PENALTY = 7.0
"""Fall of the sum of squares that a further parameter must bring: chance does once in 100."""
_RIGHT_POSE = tuple(f"right.pose.{name}" for name in POSE_NAMES)


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One thing that may have changed."""

    cause: str
    """In words: `zero of right_elbow`."""
    names: tuple[str, ...]
    """Parameters to learn anew if it did."""
    basis: NDArray
    """Directions of change among all parameters. Shape (P, m)."""
    command: str
    """The command that learns just that, with MODEL, DATASET and OUT to fill in."""


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """How well one change explains what was seen."""

    hypothesis: Hypothesis
    """The change."""
    statistic: float
    """Fall of the sum of squared innovations, chi-square of `dof` if nothing changed."""
    dof: int
    """Parameters of the change."""
    score: float
    """`statistic` less `PENALTY` for each parameter: the largest wins."""
    change: NDArray
    """Most likely change along the basis. Shape (dof,)."""
    sigma: NDArray
    """Standard deviation of `change`. Shape (dof,)."""


def diagnose(
    model: SelfModel, names: tuple[str, ...], innovations: Innovations
) -> tuple[Diagnosis, ...]:
    """Rank what may have changed by how well it explains innovations.

    Args:
        model: The body as it was.
        names: Parameters that the innovations speak of.
        innovations: Sightings after the change.

    Returns:
        Explanations, the best first.
    """
    r, slopes = innovations.whitened
    r, slopes = r.ravel(), slopes.reshape(-1, slopes.shape[2])
    found = []
    for hypothesis in hypotheses(model, names):
        h = slopes @ hypothesis.basis
        information = h.T @ h
        size = np.sqrt(np.maximum(np.diag(information), 1e-300))
        # Directions that these sightings do not show explain nothing.
        values, vectors = np.linalg.eigh(information / np.outer(size, size))
        kept = values > 1e-9
        inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T / np.outer(size, size)
        gain = h.T @ r
        statistic, m = float(gain @ inverse @ gain), int(kept.sum())
        score = statistic - m * PENALTY
        sigma = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        found.append(Diagnosis(hypothesis, statistic, m, score, inverse @ gain, sigma))
    return tuple(sorted(found, key=lambda d: -d.score))


def hypotheses(model: SelfModel, names: tuple[str, ...]) -> tuple[Hypothesis, ...]:
    """Return what may change: each zero, each gear, each tracked point, the eyes.

    Args:
        model: The body.
        names: Parameters that the sightings depend on.
    """
    found = [
        _simple(
            f"zero of {joint}",
            (f"{joint}.theta_offset",),
            names,
            f"nico-selfmodel rezero MODEL DATASET --joint {joint} --out OUT",
        )
        for joint in model.joints
    ]
    relearn = "nico-selfmodel check MODEL DATASET --relearn --out OUT"
    found += [_gear(joint, names, relearn) for joint in model.joints]
    for marker in model.markers:
        own = tuple(f"hand.{marker}.{axis}" for axis in "xyz")
        command = f"nico-selfmodel calibrate tool MODEL DATASET --tool {marker} --out OUT"
        found.append(_simple(f"point {marker} on the hand", own, names, command))
    found.append(_simple("base of the arm against the eyes", M0_NAMES, names, relearn))
    if set(_RIGHT_POSE) <= set(names):
        found.append(_simple("pose of the right eye", _RIGHT_POSE, names, relearn))
        found.append(_left_eye(model, names, relearn))
    return tuple(found)


def _simple(cause: str, own: tuple[str, ...], names: tuple[str, ...], command: str) -> Hypothesis:
    basis = np.zeros((len(names), len(own)))
    basis[[names.index(name) for name in own], np.arange(len(own))] = 1.0
    return Hypothesis(cause, own, basis, command)


def _gear(joint: str, names: tuple[str, ...], command: str) -> Hypothesis:
    """A gear changes about the zero at which it was mounted: both of its numbers move."""
    own = (f"{joint}.gear", f"{joint}.theta_offset")
    return _simple(f"gear of {joint}", own, names, command)


def _left_eye(model: SelfModel, names: tuple[str, ...], command: str) -> Hypothesis:
    """The left eye is the world: when it turns, arm and right eye seem to move together.

    x -> x + w x x + t moves M0 and the right eye's pose alike, their rotation vectors by the
    inverse of `rotation_vector_slope`.
    """
    basis = np.zeros((len(names), 6))
    parameters, rig = model.parameters, model.rig
    frames = (
        (M0_NAMES[3:], M0_NAMES[:3], parameters.base_turn, model.dh.X_W0[:3, 3]),
        (_RIGHT_POSE[:3], _RIGHT_POSE[3:], rig.values[20:23], rig.X_LR[:3, 3]),
    )
    for turns, places, vector, place in frames:
        rows = [names.index(name) for name in turns]
        basis[np.ix_(rows, range(3))] = np.linalg.inv(rotation_vector_slope(vector))
        rows = [names.index(name) for name in places]
        basis[np.ix_(rows, range(3))] = -skew(place)
        basis[np.ix_(rows, range(3, 6))] = np.eye(3)
    return Hypothesis("pose of the left eye", (*M0_NAMES, *_RIGHT_POSE), basis, command)
