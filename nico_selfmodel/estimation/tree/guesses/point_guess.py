"""A first body from points in space: the lines of each arm by the search for axes.

What carries markers is searched link by link, the nearest to the world first; where the joints on
the way are known already (a shared torso), points are taken into the frame of the last of them, and
only the rest is searched.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.initialization.axis_search import random_starts
from nico_selfmodel.estimation.initialization.start_search import (
    ASTRAY,
    RANDOM,
    few_rows,
    search_starts,
)
from nico_selfmodel.estimation.observations.arm_estimate import ArmEstimate
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.geometry.rotation import tangent_basis
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.encoder_units import ANGLES
from nico_selfmodel.model.tree.body_tree import PRISMATIC, REVOLUTE, WORLD, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.losses import robust_scale

_STARTS = 40
"""Random starts of one search at most."""
_AGREEING, _ALIKE = 3, 1.01
"""How many of the starts must leave alike, and how much more than the best one these may leave."""
_MOST_MARKERS = 24
"""Markers of a link by which its joints are searched, those that were located most often: a start
gains nothing from the corners of dozens of tags, each of which is three numbers more to find."""
POINT_SIGMA = 1e-3
"""Whitening of points whose noise is not known [m]; it only sets units."""


@dataclass(frozen=True, eq=False)
class SeenPoints:
    """Markers in W, measured or reconstructed."""

    pose: NDArray
    """Samples. Shape (N,)."""
    marker: NDArray
    """Markers. Shape (N,)."""
    p_WM: NDArray
    """Positions [m]. Shape (N, 3)."""

    def of_markers(self, markers: NDArray) -> "SeenPoints":
        """Return the points of some markers."""
        keep = np.isin(self.marker, markers)
        return SeenPoints(self.pose[keep], self.marker[keep], self.p_WM[keep])


def body_from_points(
    data: BodyDataset, tree: BodyTree, points: SeenPoints, seed: int, *, sized: bool = True
) -> BodyTree:
    """Return a body whose joints and markers are where the points ask for.

    Args:
        tree: The body to fill in: what carries what. Its geometry is not used.
        points: Markers in W.
        sized: Whether the points are in metres. Else joints that are read in metres tell how large
            the body is, if there are any, sensors and all.

    Raises:
        DataError: If a joint on the way to a marker neither turns nor shifts, or a link's points
            are too few for its joints.
    """
    seen = np.unique(points.marker)
    links = sorted({tree.markers[m].on for m in seen.tolist()}, key=lambda i: _depth(tree, i))
    known: set[int] = set()
    for link in links:
        path = np.flatnonzero(tree.beyond[link]).tolist()
        rest = [i for i in path if i not in known]
        own = np.array([m for m in seen.tolist() if tree.markers[m].on == link])
        if rest:
            most = _located_most(own, points)
            local = _in_link(data, tree, points.of_markers(most), _last_known(path, known))
            tree = _searched(data, tree, rest, most, local, seed)
            known |= set(rest)
            own = np.setdiff1d(own, most)
        tree = _placed(
            tree, own, _in_link(data, tree, points.of_markers(own), _last_known(path, known))
        )
    return _with_known_gears(data, tree, sized)


def _located_most(markers: NDArray, points: SeenPoints) -> NDArray:
    """Return those of a link's markers by which its joints are searched, in their order."""
    count = np.sum(points.marker[:, None] == markers, axis=0)
    return np.sort(markers[np.argsort(-count, kind="stable")[:_MOST_MARKERS]])


def _with_known_gears(data: BodyDataset, tree: BodyTree, sized: bool) -> BodyTree:
    """Return a body with the gears that are known in place of those that were found.

    One that was told in any unit of length becomes as large as its shifting joints travel.
    """
    known = np.array([joint.gear_known for joint in data.joints])
    shifting = known & np.array([motion == PRISMATIC for motion in tree.motions])
    if shifting.any() and not sized:
        tree = tree.scaled(float(np.median(tree.gear[shifting])))
    return replace(tree, gear=np.where(known, 1.0, tree.gear))


def _depth(tree: BodyTree, link: int) -> int:
    return 0 if link == WORLD else int(tree.beyond[link].sum())


def _last_known(path: list[int], known: set[int]) -> int:
    done = [i for i in path if i in known]
    return done[-1] if done else WORLD


def _in_link(data: BodyDataset, tree: BodyTree, points: SeenPoints, link: int) -> SeenPoints:
    """Return points in the frame of a link that is known."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    R = motion.R_WL[link][:, :, points.pose].transpose(2, 0, 1)
    p = points.p_WM - motion.p_WL[link][:, points.pose].T
    return replace(points, p_WM=(np.swapaxes(R, 1, 2) @ p[:, :, None])[:, :, 0])


def _placed(tree: BodyTree, own: NDArray, local: SeenPoints) -> BodyTree:
    """Put markers where their link's points are, by the median."""
    markers = list(tree.markers)
    for m in own.tolist():
        at = np.median(local.p_WM[local.marker == m], axis=0)
        markers[m] = replace(markers[m], X_LA=transform(markers[m].X_LA[:3, :3], at))
    return tree.with_markers(tuple(markers))


def _searched(
    data: BodyDataset,
    tree: BodyTree,
    joints: list[int],
    own: NDArray,
    local: SeenPoints,
    seed: int,
) -> BodyTree:
    """Search the lines of joints that carry the points, and put both into the body."""
    observations = limb_observations(data, tree, joints, own, local)
    known = np.array([data.joints[i].gear_known for i in joints])
    shifting = np.array([tree.motions[i] == PRISMATIC for i in joints])
    zero = np.where(known | shifting, 0.0, np.median(observations.angles, axis=0))
    few = few_rows(observations, seed)
    rng = np.random.default_rng((seed, 1))
    astray = np.inf if shifting.any() else ASTRAY * few.size
    drawn = islice(random_starts(few, known, zero, rng, worst=astray, shifting=shifting), _STARTS)
    if shifting.any():
        return _best_of(data, tree, joints, own, local, drawn)
    starts = ((RANDOM, arm) for arm in drawn)
    arm = search_starts(observations, few, starts, known, POINT_SIGMA, "cauchy", astray).best.arm
    return _with_arm(tree, joints, own, arm)


def _best_of(
    data: BodyDataset,
    tree: BodyTree,
    joints: list[int],
    own: NDArray,
    local: SeenPoints,
    drawn: Iterator[ArmEstimate],
) -> BodyTree:
    """Return the body of the best of the starts, in which some joints shift."""
    found: list[tuple[float, BodyTree]] = []
    for arm in drawn:
        made, link = _with_arm(tree, joints, own, arm), int(tree.parent[joints[0]])
        motion = TreeMotion.at(made, data.si_readings, data.X_flange)
        there = replace(local, p_WM=motion.points(local.marker, local.pose))
        missed = _in_link(data, made, there, link).p_WM - local.p_WM
        found.append((robust_scale(np.linalg.norm(missed, axis=1), 3), made))
        found.sort(key=lambda one: one[0])
        if len(found) >= _AGREEING and found[_AGREEING - 1][0] < _ALIKE * found[0][0]:
            break
    return found[0][1]


def _with_arm(tree: BodyTree, joints: list[int], own: NDArray, arm: ArmEstimate) -> BodyTree:
    """Write an arm, moved to zero readings, into the body."""
    shifting = np.array([tree.motions[i] == PRISMATIC for i in joints])
    chain = arm.chain.rezeroed(np.where(shifting, 0.0, -arm.zero / arm.gear))
    return _with_chain(tree, joints, own, chain, arm.gear)


def limb_observations(
    data: BodyDataset,
    tree: BodyTree,
    joints: list[int],
    own: NDArray,
    local: SeenPoints,
) -> Observations:
    """Return points on one link as the search for the axes of an arm takes them.

    Args:
        joints: Those that move the points, which turn or shift.
        own: Markers of the link.
        local: Their points, in the frame that carries the first of the joints.

    Raises:
        DataError: If a joint neither turns nor shifts, or the points are too few.
    """
    names = tuple(data.joints[i].name for i in joints)
    wrong = [data.joints[i].name for i in joints if tree.motions[i] not in (REVOLUTE, PRISMATIC)]
    if wrong:
        raise DataError(
            f"the place of {listed(wrong)} cannot be found from nothing, only that of joints can "
            "that turn or shift: give the robot's description"
        )
    fewest = -(-(4 * len(joints) + 3 * len(own)) // 3)
    if len(local.pose) < fewest:
        raise DataError(
            f"{listed([data.markers[m].name for m in own.tolist()])} were located "
            f"{len(local.pose)} times, {fewest} are needed at least for the joints "
            f"{listed(names)}: record more"
        )
    q = data.si_readings @ tree.coupling.T
    count = len(names)
    own_units = [data.joints[i].encoder_unit for i in joints]
    units = ServoMap(
        names,
        np.zeros(count),
        np.ones(count),
        tuple(unit if unit in ANGLES else "rad" for unit in own_units),
        np.array([data.joints[i].counts_per_turn or 1.0 for i in joints]),
        np.array([data.joints[i].sign for i in joints]),
    )
    return Observations(
        names,
        tuple(data.markers[m].name for m in own.tolist()),
        q[local.pose][:, joints],
        np.searchsorted(own, local.marker),
        local.p_WM,
        data.sample[local.pose],
        data.pose[local.pose],
        data.visit[local.pose],
        np.arange(len(local.pose)),
        np.zeros((len(local.pose), len(names))),
        units,
    )


def _with_chain(
    tree: BodyTree, joints: list[int], own: NDArray, chain: Chain, gear: NDArray
) -> BodyTree:
    """Write lines at zero readings into joint frames, z along each axis."""
    basis = tangent_basis(chain.directions)
    X_FJ = transform(np.concatenate([basis, chain.directions[:, :, None]], axis=2), chain.points)
    X_PJ, gears = np.array(tree.X_PJ), np.array(tree.gear)
    before = np.eye(4)
    for i, X, g in zip(joints, X_FJ, gear, strict=True):
        X_PJ[i], gears[i] = inverse(before) @ X, g
        before = X
    markers: list[Attached] = list(tree.markers)
    p_NH = (chain.p_WH_zero - before[:3, 3]) @ before[:3, :3]
    for m, p in zip(own.tolist(), p_NH, strict=True):
        markers[m] = replace(markers[m], X_LA=transform(markers[m].X_LA[:3, :3], p))
    return replace(tree, X_PJ=X_PJ, gear=gears, markers=tuple(markers))
