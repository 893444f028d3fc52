"""What of the own body is not known, as it looks in mirrors while nothing is on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.sessions.looks.expecting import MOST_UNLIKE, POINT_SIGMA, Unknown
from nico_selfmodel.vision.surprise.surprise import about_the_loose

COLOR_SIGMA = 0.01
"""What colours are not known by once the body has been looked at, as a share of the grey level; set
on robots 0 and 1."""
COLORS = (COLOR_SIGMA, 0.02, 0.04, 0.08)
"""What colours and light of a link may turn out not to be known by, as a share."""
POINTS = (2.5e-4, 3.5e-4, 5e-4, 7e-4, 1e-3, 1.4e-3, 2e-3, POINT_SIGMA)
"""What places of a link may turn out not to be known by [m]."""
MOVING = 7e-4
"""What places of a link that moves are not known by at least: what is thin, as a rim or a crack,
shows in one picture and not in the next, by where it falls between pixels [m]."""
_STRANGE_SIGMA = 0.8
"""Of where what is strange is seen, so that nothing within 3 px of it is judged [px]."""


@dataclass(frozen=True, eq=False)
class Told:
    """What looks at the unmarked body tell of each of `POINTS`, at one share of `COLORS`."""

    likely: NDArray
    """Mean log likelihood of the pixels of each link. Shape (P, L)."""
    share: NDArray
    """Of its places those that are even weakly surprising. Shape (P, L)."""
    strange: NDArray
    """Number of the link that is so in each pixel of left and right picture, -1 where none is.
    Shape (P, 2, h, w)."""
    links: Mapping[str, int]
    """Those that are judged, and which of L they are."""
    alarms: NDArray
    """Places of each link that surprise beyond chance. Shape (P, L)."""
    moving: frozenset[str]
    """Links of the arm, of which nothing is strange at a place of the picture."""


def least_unknown(told: Callable[[float], Told]) -> Unknown:
    """Return how far each link looks otherwise than expected.

    Of several sigmas of its place those count that leave next to nothing of the link even weakly
    surprising, for what is wrong there is wrong in every look, and noise adds to it; of them the
    likeliest. What is left is strange: a crack that is seen into, which tells of itself and not of
    the link. Where no sigma does its colours are known less, by as little as leaves one: the light
    stands in the room, and is taken to stand with the robot, which may be turned there by some
    degrees. Where that leaves none the largest counts of its place. What is strange on a link that
    moves is elsewhere in the next picture: none may be beyond chance there, and a link of which
    some is, whatever counts, is not judged.

    Args:
        told: What looks tell where colours are known to a share; asked for more as needed.
    """
    points: dict[str, float] = {}
    colors: dict[str, float] = {}
    strange: list[NDArray] = []
    untold: frozenset[str] = frozenset()
    for color in COLORS:
        found = told(color)
        calm = np.where(found.share > MOST_UNLIKE, -np.inf, found.likely)
        untold = frozenset(found.links.keys() & found.moving)
        for k in (found.links[name] for name in untold):
            calm[(found.alarms[:, k] > 0) | (np.array(POINTS) < MOVING), k] = -np.inf
        for name, k in found.links.items():
            if name not in points and np.isfinite(calm[:, k]).any():
                best = int(np.argmax(calm[:, k]))
                points[name], colors[name] = POINTS[best], color
                if name not in found.moving:
                    strange.append(found.strange[best] == k)
        untold -= points.keys()
        if found.links.keys() <= points.keys():
            break
    less = {name: color for name, color in colors.items() if color > COLOR_SIGMA}
    about = None if not strange else _about(np.any(strange, axis=0))
    return Unknown(points, POINT_SIGMA, COLOR_SIGMA, less, about, untold)


def _about(strange: NDArray) -> tuple[NDArray, NDArray]:
    """Return what lies about strange places of left and right picture. Shape (h, w) each."""
    left, right = (about_the_loose(np.where(one, _STRANGE_SIGMA, np.nan)) for one in strange)
    return left, right
