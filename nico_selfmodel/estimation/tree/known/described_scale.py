"""How sure lengths are that a robot's description alone tells.

Frames are off alike, by a standard deviation that the data tell. One link that is described much
too long is no such draw, and where few places are told by anything else what was seen fits without
it: all lengths are wrong by what it is. They are as sure as they would be without the place that
tells most of them. With g the slope of the usual logarithm of how far markers are from cameras, C
the covariance, C_j that with the place of joint j known `_UNKNOWN` times worse, and d what a larger
body does to all parameters, g'd = 1, C + (max_j g' C_j g - g' C g) d d' is the covariance.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.sensors import CAMERA
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TURNS
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import DESCRIBED, Priors, TreeSetup
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.optimization.uncertainty import Uncertainty, covariance_told_by

_FEWEST_TOLD = 10.0
"""Parts of a description that tell its standard deviation, to 22 in 100."""
_UNKNOWN = 100.0
"""Times its standard deviation that a place which is not known may be off."""
_CHANCE = 5e-5
"""How often places, or turns, of a sound description may contradict a recording."""
_STEP = 1e-6
"""Of the slopes [rad or m]."""


@dataclass(frozen=True, eq=False)
class DescribedScale:
    """What tells lengths where a description alone does, and hardly anything how far it is off."""

    told: float
    """Parts of its places that the recording tells."""
    places: int
    """Parts that it has."""
    joint: str
    """The joint whose place tells most of the lengths."""
    sigma: float
    """Standard deviation of the logarithm of all lengths without that place."""
    added: NDArray
    """Change of all free parameters by what that is more than with it. Shape (k,)."""

    @classmethod
    def of(
        cls, problem: TreeProblem, solution: TreeSolution, setup: TreeSetup, known: Uncertainty
    ) -> "DescribedScale | None":
        """Ask for it; None where something else tells lengths, or much the description's sigma."""
        if setup.scale_from != DESCRIBED or not setup.alike:
            return None
        priors = problem.priors
        places = [name for name in setup.alike[1].names if name in priors]
        told = _told(places, priors, known)
        if told >= _FEWEST_TOLD:
            return None
        along = problem.residuals.parameters.layout.by_scale(solution.values)[problem.columns]
        slope = _of_distance(problem, solution)
        slope = slope / float(slope @ along)
        usual = float(slope @ known.covariance @ slope)
        sigma = np.array([priors[n][1] if n in priors else np.inf for n in problem.free_names])
        information = solution.whitened.T @ solution.whitened
        without = {}
        for joint in problem.residuals.parameters.base.joints:
            own = np.isin(problem.free_names, [f"{joint}.{part}" for part in SHIFTS])
            own &= np.isin(problem.free_names, places)
            H = information - np.diag(np.where(own, (1.0 - _UNKNOWN**-2) / sigma**2, 0.0))
            without[joint] = float(slope @ covariance_told_by(H) @ slope)
        joint = max(without, key=lambda one: without[one])
        added = np.sqrt(max(without[joint] - usual, 0.0)) * along
        return cls(told, len(places), joint, float(np.sqrt(without[joint])), added)

    @property
    def warning(self) -> str:
        """What is said of it."""
        off = f"by {100.0 * self.sigma:.2g} %" if self.sigma < 1.0 else "by anything"
        return (
            "scale: the robot's description alone tells lengths, and what was recorded tells "
            f"{self.told:.1f} of its {self.places} places. A description that is larger or smaller "
            f"as a whole fits as well, and if {self.joint!r}, which tells most, is described "
            f"wrongly, all lengths may be off {off} (sigmas count that): record a known distance "
            "(`distance_m`), let the cameras see more of the body in more poses, or state how sure "
            "the description is (--robot-sigma DEG,MM)"
        )


def doubting(known: Uncertainty, scale: DescribedScale | None) -> Uncertainty:
    """Return a covariance with lengths as sure as they are without the place that tells most."""
    if scale is None:
        return known
    covariance = known.covariance + np.outer(scale.added, scale.added)
    return replace(known, covariance=covariance, sigma=np.hypot(known.sigma, scale.added))


def contradicted_description(
    priors: Priors, values: Mapping[str, float], known: Uncertainty
) -> str | None:
    """Say that a recording contradicts a description that is stated to be so sure.

    Squares of told parts are chi square of as many as are told, at most.

    Args:
        priors: Of the description's parts.
        values: Of these parts.
    """
    for parts in (SHIFTS, TURNS):
        own = [name for name in priors if name.rpartition(".")[2] in parts]
        told = _told(own, priors, known)
        off = {name: (values[name] - priors[name][0]) / priors[name][1] for name in own}
        squares = sum(one**2 for one in off.values())
        if told <= 0.0 or chi_square_tail(squares, int(np.ceil(told))) > _CHANCE:
            continue
        worst = max(off, key=lambda name: abs(off[name]))
        return (
            "what was recorded contradicts the robot's description, which is stated to be this "
            f"sure: its {'places' if parts is SHIFTS else 'turns'} are off by "
            f"{np.sqrt(squares / told):.2g} times what --robot-sigma says, {worst!r} most, and it "
            "alone tells lengths: check it (one link that is too long makes others look too "
            "short), or state that it is less sure"
        )
    return None


def _told(names: Sequence[str], priors: Priors, known: Uncertainty) -> float:
    """Return how many parts a recording tells: 1 - c / v of one of variance v before, c after.

    (MacKay 1992. Bayesian interpolation.)
    """
    left = dict(zip(known.names, np.diag(known.covariance).tolist(), strict=True))
    return sum(max(1.0 - left[name] / priors[name][1] ** 2, 0.0) for name in names)


def _of_distance(problem: TreeProblem, solution: TreeSolution) -> NDArray:
    """Return derivatives of the mean logarithm of distances from cameras to markers. Shape (k,).

    Where no camera sees anything, of distances from the base to what touches.
    """
    seen, parameters = problem.observations, problem.residuals.parameters
    cameras = [rows for rows in seen.sensors if rows.kind == CAMERA]

    def usual(values: NDArray) -> float:
        tree = parameters.tree_of(values)
        motion = TreeMotion.at(tree, seen.data.si_readings, seen.data.X_flange)
        places = {sensor.name: sensor for sensor in tree.sensors}
        logs = []
        for rows in cameras or seen.sensors:
            away = motion.points(rows.marker, rows.pose)
            if rows.kind == CAMERA:
                away = away - motion.pose_of(places[rows.name])[1].T[rows.pose]
            logs.append(np.log(np.linalg.norm(away, axis=1)))
        return float(np.concatenate(logs).mean())

    steps = _STEP * np.eye(len(solution.values))[problem.columns]
    both = [(usual(solution.values + h), usual(solution.values - h)) for h in steps]
    return np.array([(after - before) / (2.0 * _STEP) for after, before in both])
