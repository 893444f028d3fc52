"""What a first body tells of cameras and markers that did not take part in finding it."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.sensors import POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.guesses.camera_guess import resected
from nico_selfmodel.estimation.tree.guesses.point_guess import SeenPoints
from nico_selfmodel.estimation.tree.tree_observations import SensorRows, TreeObservations
from nico_selfmodel.geometry.rotation import nearest_rotation, rotation_from_vector
from nico_selfmodel.geometry.transform import inverse, transform
from nico_selfmodel.model.tree.body_tree import WORLD, Attached, BodyTree
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_TOLD = 1e-5
"""Part of the largest singular value below which a direction is open."""
_LEAST_SPREAD = 0.02
"""Root of the smallest part of a sum of squared sines below which rays tell no depth [rad]."""
_AS_FAR = 1.0
"""Distance at which markers are put of which no rays tell a depth, and of no others either [m]."""


def with_others(
    data: BodyDataset,
    tree: BodyTree,
    cameras: Mapping[str, SensorRows],
    placed: Collection[str],
    located: NDArray,
    seed: int,
) -> BodyTree:
    """Return a body with the cameras and markers that it was not found by, one after the other.

    Args:
        cameras: What they saw, by name; those that are not placed stand somewhere.
        placed: Cameras that are where they should be.
        located: Markers that are.

    Raises:
        DataError: If a camera saw too little of markers that are.
    """
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    rng, there, known = np.random.default_rng((seed, 7)), list(placed), set(located.tolist())
    while True:
        rays = _rays_of(data, motion, tree, {n: cameras[n] for n in there}, known)
        found = {m: one.meet() for m, one in rays.items() if one.told}
        tree, known = _with_places(tree, found), known | set(found)
        left = {name: rows for name, rows in cameras.items() if name not in there}
        if not left:
            far = _distance(rays, found)
            vague = {m: one.meet(far) for m, one in rays.items() if not one.told}
            return _with_places(tree, vague)
        mine = np.array(sorted(known))
        name = max(left, key=lambda one: int(np.isin(left[one].marker, mine).sum()))
        own = np.isin(left[name].marker, mine)
        pose, marker = left[name].pose[own], left[name].marker[own]
        motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
        expected = SeenPoints(pose, marker, motion.points(marker, pose))
        at = resected(left[name], tree.lenses[name], expected, name, rng)
        there.append(name)
        tree = with_sensors(tree, {name: at})


@dataclass(frozen=True, eq=False)
class _Rays:
    """Lines on a marker's link along which cameras saw it."""

    d: NDArray
    """Unit directions. Shape (N, 3)."""
    o: NDArray
    """Where the cameras were. Shape (N, 3)."""

    @cached_property
    def _sums(self) -> tuple[NDArray, NDArray]:
        """Return sum (I - d d') and sum (I - d d') o."""
        across = np.eye(3) - self.d[:, :, None] * self.d[:, None, :]
        return across.sum(axis=0), np.einsum("nij,nj->i", across, self.o)

    @property
    def told(self) -> bool:
        """Whether they tell how far away they meet."""
        return bool(np.linalg.eigvalsh(self._sums[0])[0] > _LEAST_SPREAD**2)

    def meet(self, far: float | None = None) -> NDArray:
        """Return where squared distances from all are least: sum (I - d d') (p - o) = 0. (3,).

        Args:
            far: How far away it is where they hardly tell it [m].
        """
        A, b = self._sums
        if far is not None:
            least = _LEAST_SPREAD**2
            A, b = A + least * np.eye(3), b + least * (self.o + far * self.d).mean(axis=0)
        return np.asarray(np.linalg.solve(A, b))


def _rays_of(
    data: BodyDataset,
    motion: TreeMotion,
    tree: BodyTree,
    cameras: Mapping[str, SensorRows],
    known: set[int],
) -> dict[int, _Rays]:
    """Return rays to markers, on their links, that no two cameras need to have seen at once.

    A joint turns them past one camera as well as past two, or a camera past them.
    """
    lines: dict[int, list[tuple[NDArray, NDArray]]] = {}
    by_name = {sensor.name: sensor for sensor in tree.sensors}
    for name, rows in cameras.items():
        own = ~np.isin(rows.marker, list(known))
        marker, pose = rows.marker[own], rows.pose[own]
        R_WC, p_WC = (part[..., pose] for part in motion.pose_of(by_name[name]))
        rays = np.einsum("ijn,nj->ni", R_WC, tree.lenses[name].directions(rows.measured[own]))
        told = np.isfinite(rays).all(axis=1)
        for m in np.unique(marker[told]).tolist():
            mine, link = told & (marker == m), tree.markers[m].on
            R = motion.R_WL[link][:, :, pose[mine]].transpose(2, 0, 1)
            d = np.einsum("nji,nj->ni", R, rays[mine])
            o = np.einsum("nji,nj->ni", R, (p_WC[:, mine] - motion.p_WL[link][:, pose[mine]]).T)
            lines.setdefault(m, []).append((d, o))
    return {
        m: _Rays(*(np.vstack(part) for part in zip(*parts, strict=True)))
        for m, parts in lines.items()
        if data.markers[m].xyz is None
    }


def _distance(rays: Mapping[int, _Rays], found: Mapping[int, NDArray]) -> float:
    """Return how far from their cameras markers are that were found, in the median [m]."""
    away = [np.linalg.norm(p - rays[m].o, axis=1) for m, p in found.items() if m in rays]
    return float(np.median(np.concatenate(away))) if away else _AS_FAR


def before_tracker(data: BodyDataset, tree: BodyTree, rows: SensorRows) -> BodyTree:
    """Return a body of unknown size in the frame of a tracker that saw other markers of it.

    Args:
        rows: What the tracker measured, which stands somewhere.

    Raises:
        DataError: If the tracker's rows do not tell where it stands.
    """
    X_WS, scale, places = _beside(data, tree, rows, sized=False)
    tree = _with_places(tree.scaled(scale), places)
    X_SW = inverse(X_WS)
    root = tree.parent == WORLD
    X_PJ = np.where(root[:, None, None], X_SW @ tree.X_PJ, tree.X_PJ)

    def moved(items: tuple[Attached, ...]) -> tuple[Attached, ...]:
        return tuple(
            replace(item, X_LA=X_SW @ item.X_LA) if item.on == WORLD else item for item in items
        )

    tree = replace(tree, X_PJ=X_PJ, markers=moved(tree.markers), sensors=moved(tree.sensors))
    return with_sensors(tree, {rows.name: np.eye(4)})


def with_tracker(data: BodyDataset, tree: BodyTree, rows: SensorRows) -> BodyTree:
    """Return a body with one more tracker where it saw markers of it, these placed as well.

    Args:
        rows: What the tracker measured, wherever it stands, or is on its link.

    Raises:
        DataError: If the tracker's rows do not tell where it is.
    """
    X_LS, _, places = _beside(data, tree, rows, sized=True)
    return with_sensors(_with_places(tree, places), {rows.name: X_LS})


def _with_places(tree: BodyTree, places: Mapping[int, NDArray]) -> BodyTree:
    markers = list(tree.markers)
    for m, p in places.items():
        markers[m] = replace(markers[m], X_LA=transform(markers[m].X_LA[:3, :3], p))
    return tree.with_markers(tuple(markers))


def _beside(
    data: BodyDataset, tree: BodyTree, rows: SensorRows, *, sized: bool
) -> tuple[NDArray, float, dict[int, NDArray]]:
    """Return where a tracker is on its link that saw markers of unknown place on known links.

    R p + t - s o - R_SL m = 0, with R_SL and o a marker's link in that of the tracker, is linear in
    R, t, s and every m; R is made a rotation afterwards.

    Args:
        rows: What was measured, p.
        sized: Whether the body's size is known, s = 1.

    Returns:
        X_LS, shape (4, 4), s, and m by marker, shape (3,).

    Raises:
        DataError: If the rows leave any of it open.
    """
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    links = np.array([tree.markers[m].on for m in rows.marker.tolist()])
    carrier = data.on_link(data.sensors[rows.sensor].on)
    R_WS, p_WS = motion.R_WL[carrier][:, :, rows.pose], motion.p_WL[carrier][:, rows.pose].T
    R_SL = np.einsum("jin,njk->nik", R_WS, motion.R_WL[links, :, :, rows.pose])
    o = np.einsum("jin,nj->ni", R_WS, motion.p_WL[links, :, rows.pose] - p_WS)
    seen = np.unique(rows.marker)
    N, p = len(rows.rows), rows.measured[:, :3]
    by_m = np.zeros((N, 3, len(seen), 3))
    by_m[np.arange(N), :, np.searchsorted(seen, rows.marker)] = -R_SL
    by_t, by_m = np.tile(np.eye(3), (N, 1)), by_m.reshape(3 * N, -1)
    by_R = np.einsum("ij,nk->nijk", np.eye(3), p).reshape(3 * N, 9)
    rest = np.hstack([by_t, by_m, -o.reshape(-1, 1)])
    _, singular, vt = np.linalg.svd(np.hstack([by_R, rest]), full_matrices=False)
    if len(singular) < rest.shape[1] + 9 or singular[-2] < _TOLD * singular[0]:
        raise DataError(
            f"what {rows.name!r} measured does not tell where it stands to the rest of the body: "
            "let it see more of it, or markers that cameras see, too"
        )
    M = vt[-1, :9].reshape(3, 3)
    R = nearest_rotation(M * np.sign(np.linalg.det(M) or 1.0))
    turned = -(p @ R.T).reshape(-1)
    if sized:
        found = np.linalg.lstsq(rest[:, :-1], turned + o.reshape(-1), rcond=None)[0]
        scale = 1.0
    else:
        *found, scale = np.linalg.lstsq(rest, turned, rcond=None)[0]
    found = np.asarray(found)
    places = found[3:].reshape(-1, 3)
    return transform(R, found[:3]), float(scale), dict(zip(seen.tolist(), places, strict=True))


def with_sensors(tree: BodyTree, places: Mapping[str, NDArray]) -> BodyTree:
    """Return a body with sensors of some names at X_LA. Shape (4, 4) each."""
    return replace(
        tree,
        sensors=tuple(replace(s, X_LA=places.get(s.name, s.X_LA)) for s in tree.sensors),
    )


def with_orientations(
    data: BodyDataset, tree: BodyTree, observations: TreeObservations
) -> BodyTree:
    """Turn markers as the measured orientations ask for, R_LM = mean of R_WL' R_WS R_measured."""
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange)
    markers, places = list(tree.markers), {s.name: s for s in tree.sensors}
    for rows in observations.sensors:
        if rows.kind != POSES:
            continue
        R_WS = motion.pose_of(places[rows.name])[0]
        for m in np.unique(rows.marker).tolist():
            own = np.flatnonzero(rows.marker == m)
            pose = rows.pose[own]
            R_WL = motion.R_WL[markers[m].on][:, :, pose].transpose(2, 0, 1)
            R_SM = rotation_from_vector(rows.measured[own, 3:])
            R = np.swapaxes(R_WL, 1, 2) @ R_WS[:, :, pose].transpose(2, 0, 1) @ R_SM
            turned = nearest_rotation(np.median(R, axis=0))
            markers[m] = replace(markers[m], X_LA=transform(turned, markers[m].X_LA[:3, 3]))
    return tree.with_markers(tuple(markers))
