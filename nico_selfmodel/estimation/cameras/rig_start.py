"""Where the cameras of a rig stand to begin with: pair by pair, along the boards in common."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.cameras.camera_initialization import pair_start
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.names import listed

Placed = tuple[Camera, NDArray]
"""A camera, and the pose of the board of each view before it, nan where it saw none (V, 4, 4)."""


def rig_links(views: BoardViews) -> tuple[tuple[str, str], ...]:
    """Return pairs that connect every camera to the first, of most boards in common (Prim's tree).

    Returns:
        A camera that is connected, and the next one; in this order they can be placed.

    Raises:
        EstimationError: If some cameras have no board in common with the others; names them.
    """
    saw = views.seen.any(axis=2).astype(int)
    common = saw.T @ saw
    placed, links = [0], []
    left = list(range(1, len(views.cameras)))
    while left:
        pairs = [(known, new) for known in placed for new in left]
        known, new = max(pairs, key=lambda pair: common[pair])
        if common[known, new] == 0:
            raise EstimationError(_no_common_board(views.cameras, placed, left))
        links.append((views.cameras[known], views.cameras[new]))
        placed.append(new)
        left.remove(new)
    return tuple(links)


def _no_common_board(cameras: Sequence[str], placed: list[int], left: list[int]) -> str:
    if len(cameras) == 2:
        return "no view shows the board to both cameras: they need boards in common"
    one, other = (listed([cameras[k] for k in sorted(part)]) for part in (placed, left))
    return (
        f"no view shows the board to one of {one} and to one of {other}: cameras of a rig are "
        "connected by boards that two of them see at once"
    )


def rig_start(alone: Sequence[Placed], views: BoardViews) -> tuple[tuple[Camera, ...], NDArray]:
    """Place all cameras in the frame of the first, and all boards.

    Args:
        alone: Each camera by itself, in the order of `views.cameras`.

    Returns:
        The cameras, and X_LG of all views, shape (V, 4, 4).

    Raises:
        EstimationError: If cameras share no board, or the corners of a pair allow no relative pose.
    """
    by_name = dict(zip(views.cameras, alone, strict=True))
    X_LC = {views.cameras[0]: np.eye(4)}
    for known, new in rig_links(views):
        X = pair_start(by_name[known], by_name[new], views.pair(known, new))
        X_LC[new] = X_LC[known] @ X
    X_LG = np.full((len(views), 4, 4), np.nan)
    for name, (_, X_CG) in by_name.items():
        X_LG = np.where(np.isfinite(X_LG), X_LG, X_LC[name] @ X_CG)
    return tuple(by_name[name][0].at(X_LC[name]) for name in views.cameras), X_LG
