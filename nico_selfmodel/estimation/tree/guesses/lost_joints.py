"""Joints of which nothing located a marker in space, told by what cameras of known place see.

One camera's bearings of an arm are no points to search axes by, and no start from afar is sure to
come home: of random frames, near each other and turned by some 45 deg, about one in ten does. All
are adjusted by bearings alone, what is known held, until two miss them alike.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.among_unknown import on_link_among_unknown
from nico_selfmodel.estimation.tree.guesses.by_first_body import with_others, with_sensors
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import SHIFTS, TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import WORLD, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_STARTS = 60
"""Random frames that are tried at most."""
_TURN, _APART = 0.8, 0.05
"""Standard deviations of each part of their turns [rad] and places [m]."""
_ALIKE = 1.1
"""How much more than the best another start may miss bearings by, and be the same."""


def before_known_joints(
    data: BodyDataset,
    tree: BodyTree,
    cameras: Mapping[str, SensorRows],
    located: NDArray,
    seed: int,
) -> BodyTree | None:
    """Return a body before cameras that saw unknown markers which known joints carry.

    Args:
        tree: A body whose joints are known as far as some markers are located.
        cameras: What standing cameras saw, by name.
        located: These markers.

    Returns:
        The body, its other joints too; None where no camera saw enough.
    """
    rng, own = np.random.default_rng((seed, 10)), on_known(tree, located)
    motion, places = TreeMotion.at(tree, data.si_readings, data.X_flange), {}
    for name, rows in cameras.items():
        at = on_link_among_unknown(motion, rows.only(own[rows.marker]), WORLD, rng)
        if at is not None:
            places[name] = at
    if not places:
        return None
    tree = with_others(data, with_sensors(tree, places), cameras, list(places), located, seed)
    return with_lost_joints(data, tree, cameras, located, seed)


def with_lost_joints(
    data: BodyDataset,
    tree: BodyTree,
    cameras: Mapping[str, SensorRows],
    located: NDArray,
    seed: int,
) -> BodyTree:
    """Return a body with the joints that carry no located marker, as cameras see what they carry.

    Args:
        tree: The body, its cameras in place.
        cameras: What standing cameras saw, by name.
        located: Markers that told its joints.
    """
    own = on_known(tree, located)
    seen = np.unique(np.concatenate([located, *(rows.marker for rows in cameras.values())]))
    unknown = seen[~own[seen]]
    carried = [tree.markers[m].on for m in unknown.tolist()]
    lost = tree.beyond[carried].any(axis=0) & ~joints_found(tree, located)
    if not lost.any():
        return tree
    table, parameters = data.observations, TreeParameters(tree)
    by_camera = np.array([s.name in cameras for s in data.sensors])[table.sensor]
    rays = TreeObservations.of(data, by_camera & np.isin(table.marker, unknown))
    rays = rays.as_bearings(tree.lenses)
    joints = np.flatnonzero(lost).tolist()
    free = {f"{tree.markers[m].name}.{part}" for m in unknown.tolist() for part in SHIFTS}
    free |= {name for i in joints for name in parameters.line_of(tree.joints[i])}
    rng, known, found = np.random.default_rng((seed, 11)), np.flatnonzero(own), []
    for _ in range(_STARTS):
        X_PJ = np.array(tree.X_PJ)
        for i in joints:
            turn, place = _TURN * rng.normal(size=3), _APART * rng.normal(size=3)
            X_PJ[i] = transform(rotation_from_vector(turn), place)
        first = with_others(
            data, replace(tree, X_PJ=X_PJ), cameras, list(cameras), known, seed
        )  # fmt: skip
        residuals = TreeResiduals(rays, TreeParameters(first))
        problem = TreeProblem(residuals, frozenset(free), {})
        values = problem.rough(residuals.parameters.start)[0]
        missed = float(np.median(np.abs(residuals.residuals(values))))
        found.append((missed, len(found), residuals.parameters.tree_of(values)))
        found.sort()
        if len(found) > 1 and found[1][0] < _ALIKE * found[0][0]:
            break
    return found[0][2]


def joints_found(tree: BodyTree, located: NDArray) -> NDArray:
    """Return which joints move located markers. Boolean, shape (n,)."""
    return np.asarray(tree.beyond[[tree.markers[m].on for m in located.tolist()]].any(axis=0))


def on_known(tree: BodyTree, located: NDArray) -> NDArray:
    """Return which markers such joints alone move. Boolean, shape (m,)."""
    moving = tree.beyond[[marker.on for marker in tree.markers]]
    return np.asarray(~(moving & ~joints_found(tree, located)).any(axis=1))
