"""Which poses before a mirror tell most of where the glass stands.

With J the derivatives of a pose's pixels by the plane's numbers and S what joint noise and cameras
do to them (see `noise.pose_noise`), the pose tells M = J' S^-1 J; a root of M stands for it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.of_tree import camera_infos, link_joints_of, marker_infos
from nico_selfmodel.estimation.noise.pose_groups import PoseGroups
from nico_selfmodel.estimation.noise.pose_noise import PoseNoise, PoseWhitening
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.planning.pose_selection import choose_poses

_JOINT, _PIXEL = np.radians(0.35), 0.3
"""Noise of a joint [rad] and of a pixel coordinate, of which only the ratio decides anything."""
_BEFOREHAND = np.diag(1.0 / np.array([0.1, 0.1, 0.05]))
"""The glass is about where it is meant to stand: tilts [rad], distance [m]."""


def most_telling(
    tree: BodyTree,
    mirror: StandingMirror,
    q: NDArray,
    direct: NDArray,
    reflected: NDArray,
    count: int,
) -> NDArray:
    """Choose the poses after which the glass' distances from the cameras are known best.

    Args:
        tree: The body, and what is about it.
        mirror: Where the glass is meant to stand.
        q: Angles of all joints [rad]. Shape (N, n).
        direct: Which cameras see which markers themselves. Boolean, shape (N, cameras, markers).
        reflected: Which they see in the glass, likewise.
        count: How many to choose, N at most.

    Returns:
        Rows of the poses. Shape (count,).
    """
    told = choose_poses(
        _roots(tree, mirror, q, direct, reflected),
        count,
        targets=_distances(tree, mirror, q),
        given=_BEFOREHAND[None],
    )
    return told.rows


def _roots(
    tree: BodyTree, mirror: StandingMirror, q: NDArray, direct: NDArray, reflected: NDArray
) -> NDArray:
    """Return a root of what each pose tells. Shape (N, 3, 3)."""
    data = _recording(tree, q, [("", direct), (mirror.name, reflected)])
    observations, parameters = TreeObservations.of(data), TreeParameters(_with(tree, mirror))
    linear = TreeResiduals(observations, parameters).linear(parameters.values_of(parameters.base))
    sample, scalars = observations.sample, observations.scalars
    groups = PoseGroups(sample, np.ones(scalars, dtype=bool), 1)
    noise = PoseNoise(1.0, np.full(len(observations.noisy_joints), _JOINT))
    whitening = PoseWhitening(groups, (linear.by_joint / _PIXEL)[:, None], noise)
    J = linear.J[parameters.mirror(mirror.name)] / _PIXEL
    _, white = whitening.whiten(np.zeros((1, scalars)), J[:, None])
    told = np.zeros((len(q), 3, 3))
    np.add.at(told, sample, np.einsum("ir,jr->rij", white[:, 0], white[:, 0]))
    squares, vectors = np.linalg.eigh(told)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0))[:, :, None] * np.swapaxes(vectors, 1, 2))


def _distances(tree: BodyTree, mirror: StandingMirror, q: NDArray) -> NDArray:
    """Return derivatives of n.x + d at the cameras by the plane's numbers. Shape (M, 1, 3)."""
    motion = TreeMotion.at(tree, q)
    p_WC = np.concatenate([motion.pose_of(sensor)[1].T for sensor in tree.sensors])
    return (np.column_stack([p_WC, np.ones(len(p_WC))]) @ mirror.slopes)[:, None]


def _with(tree: BodyTree, mirror: StandingMirror) -> BodyTree:
    return tree.with_mirrors((mirror,))


def _recording(tree: BodyTree, q: NDArray, seen: Sequence[tuple[str, NDArray]]) -> BodyDataset:
    """Return what would be recorded at some poses, whatever its pixels were."""
    rows = [(name, np.argwhere(which)) for name, which in seen]
    pose, sensor, marker = np.concatenate([found for _, found in rows]).T
    values = np.full((len(pose), 6), np.nan)
    values[:, :2] = 0.0
    names = np.concatenate([np.full(len(found), name) for name, found in rows])
    table = ObservationTable(pose, sensor, marker, np.full(len(pose), -1), values, names)
    return BodyDataset(
        "planned",
        link_joints_of(tree),
        marker_infos(tree),
        camera_infos(tree),
        np.arange(len(q)),
        q,
        table,
    )
