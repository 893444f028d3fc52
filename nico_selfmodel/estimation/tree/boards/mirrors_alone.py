"""Mirrors and boards from boards that were seen in mirrors alone, in closed form.

A board at (R, T) is seen in mirror a, n_a.x + d_a = 0, S_a = I - 2 n_a n_a', as one at R'_a = S_a R
diag(1, 1, -1), t'_a = S_a T - 2 d_a n_a. What two mirrors show of one corner differs by a vector in
the span of n_a and n_b, so that all differences are at right angles to their common axis, and every
normal is at right angles to the axes with two other mirrors. With the normals known, T and d are
linear: T + 2 d_a n_a = S_a t'_a (three views, Sturm and Bonfort 2006; Rodrigues et al. 2010).
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.errors import NotIdentifiableError
from nico_selfmodel.estimation.tree.boards.board_pose import mirrored_back
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.rotation import nearest_rotation
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.names import listed

_APART = 0.02
"""Least spread of a mirror's axes with the others about its normal, smaller singular value to the
larger."""


def mirrors_alone(
    virtual: Mapping[str, Mapping[int, NDArray]], corners: NDArray
) -> tuple[dict[str, Plane], dict[int, NDArray]]:
    """Place mirrors and the boards that were seen in them.

    Args:
        virtual: By mirror and number of the board, where its mirror image is, (4, 4) each.
        corners: Some corners of the board, not all on one line [m]. Shape (C, 3).

    Returns:
        The glasses, n either way, and the boards' poses, (4, 4) each.

    Raises:
        NotIdentifiableError: If there are no three mirrors whose normals point three ways.
    """
    names = list(virtual)
    axes: dict[str, list[NDArray]] = {name: [] for name in names}
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            axis = _common_axis(virtual[a], virtual[b], corners)
            if axis is not None:
                axes[a].append(axis)
                axes[b].append(axis)
    normals = {name: _normal(axes[name]) for name in names}
    told = {name: n for name, n in normals.items() if n is not None}
    if len(told) < 3:
        raise NotIdentifiableError(
            f"boards were seen in {listed(names)}, never beside them: three mirrors or more must "
            "show the same boards, and their normals must not lie in one plane; turn one of them, "
            "or show the board directly, too"
        )
    return _places({name: virtual[name] for name in told}, told)


def _common_axis(
    one: Mapping[int, NDArray], other: Mapping[int, NDArray], corners: NDArray
) -> NDArray | None:
    """Return the direction along which two mirrors show the same. Shape (3,)."""
    both = sorted(set(one) & set(other))
    if not both:
        return None
    shown = [np.stack([images[k] for k in both]) for images in (one, other)]
    flipped = corners * np.array([1.0, 1.0, -1.0])
    points = [flipped @ np.swapaxes(X[:, :3, :3], 1, 2) + X[:, None, :3, 3] for X in shown]
    return np.asarray(np.linalg.svd((points[0] - points[1]).reshape(-1, 3))[2][-1])


def _normal(axes: list[NDArray]) -> NDArray | None:
    """Return what is at right angles to all axes; None where they are one. Shape (3,)."""
    if len(axes) < 2:
        return None
    _, size, vt = np.linalg.svd(np.array(axes))
    return None if size[1] < _APART * size[0] else np.asarray(vt[-1])


def _places(
    virtual: Mapping[str, Mapping[int, NDArray]], normals: Mapping[str, NDArray]
) -> tuple[dict[str, Plane], dict[int, NDArray]]:
    """Return planes and boards' poses where the normals are known."""
    names, boards = list(virtual), sorted(set().union(*virtual.values()))
    across = {name: np.eye(3) - 2.0 * np.outer(n, n) for name, n in normals.items()}
    rows, right, turns = [], [], {k: np.zeros((3, 3)) for k in boards}
    for m, name in enumerate(names):
        for k, X in virtual[name].items():
            row = np.zeros((3, 3 * len(boards) + len(names)))
            at = 3 * boards.index(k)
            row[:, at : at + 3] = np.eye(3)
            row[:, 3 * len(boards) + m] = 2.0 * normals[name]
            rows.append(row)
            right.append(across[name] @ X[:3, 3])
            turns[k] += across[name] @ mirrored_back(X)[:3, :3]
    found = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    places = found[: 3 * len(boards)].reshape(-1, 3)
    offsets = found[3 * len(boards) :].tolist()
    planes = {name: Plane(normals[name], d) for name, d in zip(names, offsets, strict=True)}
    X_WB = {
        k: transform(nearest_rotation(turns[k]), p) for k, p in zip(boards, places, strict=True)
    }
    return planes, X_WB
