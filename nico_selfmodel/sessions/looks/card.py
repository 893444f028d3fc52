"""The card of a marker on a hand: where it ends, a surface jumps, and the robot knows where."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.transform import apply, inverse, transform
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.tracking.shared_search import corner_names
from nico_selfmodel.vision.markers.fiducial_family import DEFAULT_FAMILY, FiducialFamily
from nico_selfmodel.vision.printed_pattern import QUIET

_BESIDE = 4e-3
"""How far from the rim a surface is not told apart from the jump: by a mesh of 3 mm, and a little
more; set on the hands of 1853 and 1857 [m]."""
_BELOW = 10e-3
"""How far below a card, or above it, the surface may be that it jumps to [m]."""


@dataclass(frozen=True, eq=False)
class Card:
    """A square sheet that stands above a link's surface.

    Of its rim a mesh makes a slope: what lies beside the card is hidden from one side and seen from
    the other, and colours there disagree by what no sigma tells.
    """

    X_FC: NDArray
    """Its pose in the link's frame F, in its middle, z into what carries it. Shape (4, 4)."""
    half: float
    """Half of its side [m]."""

    def __post_init__(self) -> None:
        """Make the array read-only."""
        object.__setattr__(self, "X_FC", frozen_array(self.X_FC, (4, 4), "X_FC"))

    @classmethod
    def of_corners(cls, p_FQ: NDArray) -> "Card":
        """Return the card of the usual family's marker, a white zone about it.

        Args:
            p_FQ: The marker's corners in turn, clockwise to who looks at it, as they were learned
                [m]. Shape (4, 3).
        """
        middle = p_FQ.mean(axis=0)
        right = p_FQ[1] + p_FQ[2] - p_FQ[0] - p_FQ[3]
        down = p_FQ[2] + p_FQ[3] - p_FQ[0] - p_FQ[1]
        x, normal = right / np.linalg.norm(right), np.cross(right, down)
        z = normal / np.linalg.norm(normal)
        cells = FiducialFamily(DEFAULT_FAMILY).cells
        side = np.mean([np.linalg.norm(right), np.linalg.norm(down)]) / 2.0
        half = float(side * (cells + 2 * QUIET) / cells / 2.0)
        return cls(transform(np.column_stack([x, np.cross(z, x), z]), middle), half)

    def at_rim(self, p_FQ: NDArray) -> NDArray:
        """Return which places are next to where the card ends. Shape (N, 3) -> (N,)."""
        p_CQ = apply(inverse(self.X_FC), p_FQ)
        outside = np.abs(p_CQ[:, :2]).max(axis=1) - self.half
        return (np.abs(outside) < _BESIDE) & (np.abs(p_CQ[:, 2]) < _BELOW)

    @property
    def block(self) -> NDArray:
        """Corners of what is on the card, below it, or next to it [m]. Shape (8, 3)."""
        side = self.half + _BESIDE
        corners = np.array(list(product((-side, side), (-side, side), (-_BESIDE, _BELOW))))
        return apply(self.X_FC, corners)


def card_of(model: SelfModel, readings: NDArray, X_WF: NDArray) -> Card | None:
    """Return the card on the hand, if its marker's corners were learned with the arm.

    Args:
        readings: At which the hand's link has a pose [encoder units]. Shape (n,).
        X_WF: That pose. Shape (4, 4).
    """
    for marker in model.markers:
        corners = corner_names(marker)
        if set(corners) <= set(model.markers):
            q = model.servos.to_joint(readings)
            p_WQ = [model.points(q, model.markers.index(one)) for one in corners]
            return Card.of_corners(apply(inverse(X_WF), np.array(p_WQ)))
    return None
