"""Stage 2 of the mirror test: where mirrors stand that the robot has never looked into."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.sessions.mirrors.acquaintance import rendered
from nico_selfmodel.sessions.mirrors.knowing import Knowing, Refusal

HAND, WHOLE = "its hand", "its hand, head and chest"
"""What a robot has seen of itself in a mirror when it says where that stands."""


@dataclass(frozen=True)
class MirrorPlace:
    """How far one mirror is from where a robot says it stands."""

    by: str
    """`HAND` or `WHOLE`."""
    angle: float
    """Between the normals [rad]."""
    distance: float
    """Of its distance from the left camera, positive where it is said to be farther [m]."""
    chi_square: float
    """Of its three numbers, by the covariance that is said."""


@dataclass(frozen=True)
class MirrorsStage:
    """All mirrors of all robots."""

    places: tuple[MirrorPlace, ...]
    """Those told by the hand, then those told by all of the body, robot by robot."""
    refusals: tuple[Refusal, ...] = ()
    """What robots say who do not trust their mirrors."""


def place_mirrors(robots: Sequence[Knowing], refusals: Sequence[Refusal] = ()) -> MirrorsStage:
    """Hold mirrors as robots have learned them against where they stand.

    Args:
        robots: Who know their mirrors.
        refusals: Of those who do not trust them.
    """
    found = []
    for known in robots:
        truth = rendered(known.robot).ground_truth
        for by, mirrors in ((HAND, known.robot.model.mirrors), (WHOLE, known.body.places)):
            for name, view in known.before.views.items():
                true, own = truth.mirror(view.X_BM), mirrors[name]
                found.append(_place(by, own, true))
    return MirrorsStage(tuple(found), tuple(refusals))


def _place(by: str, own: Mirror, true: Mirror) -> MirrorPlace:
    """Compare one mirror with the true one, both before the left camera."""
    assert own.covariance is not None, "a learned mirror has a covariance"
    angle = float(np.linalg.norm(np.cross(own.normal, true.normal)))
    off = own.values - true.values
    chi_square = float(off @ np.linalg.solve(own.covariance, off))
    return MirrorPlace(by, angle, own.distance - true.distance, chi_square)
