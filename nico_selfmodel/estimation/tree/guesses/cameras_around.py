"""Where cameras may be that look at a described robot: all around it, told by bearings.

No point behind a camera can trap a fit of bearings, so that it comes home from 60 deg away: six
sides of the workspace and four turns about the line of sight leave no camera out.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.touch_guess import Touches
from nico_selfmodel.estimation.tree.tree_observations import BEARING, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import FRAME_PARTS, SHIFTS, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.geometry.rotation import rotation_about, tangent_basis
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_TURNS = 4
"""About the line of sight."""
_ROUNDS = 3
_KEPT = 3
"""Places that are worth an adjustment of everything."""
_POSES = 15
"""Enough to tell one place from another."""
_NARROWEST = 0.05
"""Spread of bearings below which it tells no distance [rad]."""


def cameras_all_around(data: BodyDataset, tree: BodyTree) -> Iterator[BodyTree]:
    """Yield a body with its cameras where bearings fit best, the best place first.

    Args:
        data: The recording, of which a few poses are enough.
        tree: The robot as described; only cameras and markers move.
    """
    cameras = np.array([sensor.name in tree.lenses for sensor in data.sensors])
    table = data.observations
    seen = np.isin(np.arange(len(data.sample)), table.pose[cameras[table.sensor]])
    step = -(-int(seen.sum()) // _POSES)
    data = data.select(seen & ((np.cumsum(seen) - 1) % step == 0))
    bearings = TreeObservations.of(data, ~Touches.of(data).rows).as_bearings(tree.lenses)
    parameters = TreeParameters(tree)
    names = [*tree.lenses, *(m.name for m in tree.markers)]
    parts = {name: FRAME_PARTS if name in tree.lenses else SHIFTS for name in names}
    free = frozenset(f"{name}.{part}" for name in names for part in parts[name])
    problem = TreeProblem(TreeResiduals(bearings, parameters), free, {})
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    found = []
    for side in (*np.eye(3), *-np.eye(3)):
        for k in range(_TURNS):
            turn = 2.0 * np.pi * k / _TURNS
            placed = _placed(data, tree, bearings, motion, side, turn)
            values, cost = problem.rough(parameters.values_of(placed), _ROUNDS)
            found.append((cost, len(found), values))
    for _, _, values in sorted(found)[:_KEPT]:
        yield parameters.tree_of(values)


def _placed(
    data: BodyDataset,
    tree: BodyTree,
    bearings: TreeObservations,
    motion: TreeMotion,
    side: NDArray,
    turn: float,
) -> BodyTree:
    """Put every camera on one side of what it sees, as far away as its bearings are narrow."""
    sensors = list(tree.sensors)
    for rows in bearings.sensors:
        if rows.kind != BEARING:
            continue
        (i,) = [k for k, s in enumerate(sensors) if s.name == rows.name]
        p = motion.points_from(sensors[i].on, rows.marker, rows.pose)
        middle, ray = p.mean(axis=0), _middle_of(rows.measured)
        distance = as_far_as_seen(p, rows.measured)
        seen = np.column_stack([tangent_basis(ray), ray])
        world = np.column_stack([tangent_basis(-side), -side])
        R_WC = world @ rotation_about(np.array([0.0, 0.0, 1.0]), turn) @ seen.T
        sensors[i] = replace(sensors[i], X_LA=transform(R_WC, middle + distance * side))
    return replace(tree, sensors=tuple(sensors))


def as_far_as_seen(p: NDArray, rays: NDArray) -> float:
    """Return the distance from which what is seen looks as wide as its bearings are [m].

    Args:
        p: What is seen. Shape (N, 3).
        rays: Unit directions in the camera. Shape (N, 3).
    """
    across = float(np.sqrt(np.mean(1.0 - (rays @ _middle_of(rays)) ** 2)))
    return float(np.sqrt(np.var(p, axis=0).sum())) / max(across, _NARROWEST)


def _middle_of(rays: NDArray) -> NDArray:
    ray = rays.mean(axis=0)
    return np.asarray(ray / np.linalg.norm(ray))
