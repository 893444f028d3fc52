"""First planes of mirrors that stand in the world, by the law of reflection.

With c the camera, u the line of sight and p the marker, camera, marker, image and normal lie in
one plane: n . ((p - c) x u) = 0, whichever way the head looks. With h = n.p + d the reflection
p - 2 h n lies on the line of sight, (p - c) x u = 2 h n x u, which is linear in h.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, NotIdentifiableError
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.model.tree.tree_motion import TreeMotion

_DRAWN = 300
"""Pairs of rows whose planes of incidence are tried for a normal."""
_FAR = np.radians(8.0)
"""Angle off its plane of incidence within which a row counts: joints are not where they are read,
markers not always told apart [rad]."""
_ROUNDS = 3
"""Of rows that count and the normal by them."""
_APART = 0.02
"""Least spread of planes of incidence about the normal, smaller singular value to the larger."""


@dataclass(frozen=True, eq=False)
class _Sights:
    """What was seen in one mirror, in W."""

    p_WM: NDArray
    """Markers by the body's joints [m]. Shape (N, 3)."""
    p_WC: NDArray
    """Cameras [m]. Shape (N, 3)."""
    sight: NDArray
    """Unit lines of sight. Shape (N, 3)."""

    @property
    def across(self) -> NDArray:
        """Normals of planes of incidence, as long as the angle's sine. Shape (N, 3)."""
        way = self.p_WM - self.p_WC
        length = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
        return np.cross(way / length, self.sight)


def mirrors_in(
    data: BodyDataset, tree: BodyTree, mirrors: tuple[str, ...], seed: int = 0
) -> tuple[StandingMirror, ...]:
    """Place mirrors of a recording.

    Args:
        data: The recording, with the body's markers in its order.
        tree: The body, nearly as it is.

    Returns:
        The mirrors, the cameras and what they saw in front of each.

    Raises:
        DataError: If what was seen cannot be a reflection: the glass would be behind a camera.
        NotIdentifiableError: If too little was seen to tell how a glass is tilted.
    """
    motion = TreeMotion.at(tree, data.si_readings, data.X_flange, data.si_approach)
    rng = np.random.default_rng((seed, 27))
    return tuple(
        StandingMirror(name, _plane(name, _sights(name, data, tree, motion), rng))
        for name in mirrors
    )


def _sights(name: str, data: BodyDataset, tree: BodyTree, motion: TreeMotion) -> _Sights:
    table, parts = data.observations, []
    by_name = {sensor.name: sensor for sensor in tree.sensors}
    for rows in TreeObservations.of(data, table.mirror == name).sensors:
        camera = by_name[rows.name]
        R, p = motion.pose_of(camera)
        rays = tree.lenses[camera.name].directions(rows.measured)
        sight = np.einsum("ijn,nj->ni", R[:, :, rows.pose], rays)
        known = np.isfinite(sight).all(axis=1)
        points = motion.points(rows.marker, rows.pose)
        parts.append((points[known], p[:, rows.pose].T[known], sight[known]))
    return _Sights(*(np.concatenate(part) for part in zip(*parts, strict=True)))


def _plane(name: str, sights: _Sights, rng: np.random.Generator) -> Plane:
    across = sights.across
    normal, near = _normal(name, across, rng)
    lever = 2.0 * np.cross(normal, sights.sight[near])
    way = sights.p_WM[near] - sights.p_WC[near]
    seen = np.cross(way, sights.sight[near])
    height = np.sum(seen * lever, axis=1) / np.maximum(np.sum(lever * lever, axis=1), 1e-12)
    side = float(np.copysign(1.0, np.median(height)))
    plane = Plane(side * normal, side * float(np.median(height - sights.p_WM[near] @ normal)))
    front = plane.distance_to(sights.p_WC[near])
    toward = sights.sight[near] @ plane.normal
    if np.median(front) <= 0.0 or np.median(toward) >= 0.0:
        raise DataError(
            f"mirror {name!r} would be behind the cameras: what was seen there is no reflection of "
            "these markers; are the rows' markers and mirror named rightly?"
        )
    return plane


def _normal(name: str, across: NDArray, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Return the direction that most planes of incidence share, and which rows have it."""
    count = len(across)
    pairs = rng.integers(0, max(count, 1), (_DRAWN, 2))
    tried = np.cross(across[pairs[:, 0]], across[pairs[:, 1]])
    length = np.linalg.norm(tried, axis=1)
    good = length > 1e-9
    if not good.any():
        raise _unobservable(name, count)
    tried = tried[good] / length[good, None]
    miss = np.minimum(np.abs(tried @ across.T), np.sin(_FAR))
    normal = tried[int(np.argmin(miss.sum(axis=1)))]
    near = np.abs(across @ normal) < np.sin(_FAR)
    for _ in range(_ROUNDS):
        padded = np.concatenate([across[near], np.zeros((2, 3))])
        _, values, vt = np.linalg.svd(padded)
        if near.sum() < 2 or values[1] < _APART * values[0]:
            raise _unobservable(name, count)
        normal = vt[2]
        near = np.abs(across @ normal) < np.sin(_FAR)
    return normal, near


def _unobservable(name: str, count: int) -> NotIdentifiableError:
    return NotIdentifiableError(
        f"mirror {name!r} is unobservable: {count} reflection{'s do' if count != 1 else ' does'} "
        "not tell how it is tilted; record more poses, hands to the left and right, above and below"
    )
