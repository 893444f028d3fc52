"""Turns that a sensor tells and that fit a body as they were meant, not as they were taken."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.diagnosis.turns_written import AS_CONVENTIONS, meant_turns
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart
from nico_selfmodel.estimation.tree.tree_observations import SensorRows
from nico_selfmodel.geometry.rotation import (
    nearest_rotation,
    rotation_from_vector,
    rotation_vectors_of,
)
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_LEAST = np.radians(3.0)
"""Usual error of turns below which nobody asks how they are written [rad]."""


def refuse_other_turns(found: FoundStart, data: BodyDataset) -> None:
    """Refuse turns that fit the links of the first body as angles, inverted, w first and so on.

    A first body is found by places alone, so that its links are turned as joints have them.

    Args:
        found: The first body.
        data: The recording.

    Raises:
        DataError: If there are such.
    """
    motion = TreeMotion.at(found.tree, data.si_readings, data.X_flange)
    for rows in found.observations.sensors:
        if rows.kind != POSES:
            continue
        R_LS, vectors = _sensor_on_links(found, motion, rows), rows.measured[:, 3:]

        def misfit(R: NDArray, R_LS: NDArray = R_LS, rows: SensorRows = rows) -> float:
            return _usual_turn(R_LS @ R, rows.marker)

        off = misfit(rotation_from_vector(vectors))
        if off > _LEAST and (ways := meant_turns(off, misfit, vectors)):
            raise DataError(
                f"turns that sensor {rows.name!r} of data set {data.name!r} tells contradict its "
                f"places by {np.degrees(off):.0f} deg, and fit them if {', or '.join(ways)}: "
                f"{AS_CONVENTIONS}"
            )


def _sensor_on_links(found: FoundStart, motion: TreeMotion, rows: SensorRows) -> NDArray:
    """Return how the sensor was turned in each marker's link. Shape (N, 3, 3)."""
    (sensor,) = (one for one in found.tree.sensors if one.name == rows.name)
    R_WS = motion.pose_of(sensor)[0][:, :, rows.pose]
    on = np.array([marker.on for marker in found.tree.markers])[rows.marker]
    out = np.empty((len(on), 3, 3))
    for link in np.unique(on).tolist():
        own = on == link
        R_WL = motion.R_WL[link][:, :, rows.pose[own]]
        out[own] = np.einsum("jin,jkn->nik", R_WL, R_WS[:, :, own])
    return out


def _usual_turn(R_LM: NDArray, marker: NDArray) -> float:
    """Return by how much markers' turns on their links usually differ from pose to pose [rad]."""
    off = np.empty(len(marker))
    for m in np.unique(marker).tolist():
        own = marker == m
        middle = nearest_rotation(np.median(R_LM[own], axis=0))
        off[own] = np.linalg.norm(rotation_vectors_of(middle.T @ R_LM[own]), axis=1)
    return float(np.median(off))
