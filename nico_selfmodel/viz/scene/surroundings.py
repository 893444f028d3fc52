"""What stands around a scene: which way is up, the floor of the measuring frame, the first view."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant.learned_frames import learned_frames
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.numbers_shown import nice_below
from nico_selfmodel.viz.scene.scene import FIELD_OF_VIEW, Camera
from nico_selfmodel.viz.scene.scene_items import Item, Segments, Triad

if TYPE_CHECKING:
    from nico_selfmodel.plant import ArmDescription

_NEAR = 2.0
"""W itself is shown where it lies within this many sizes of the data."""
ASPECT = 1.15
"""Of the narrowest window that first views are made for: width over height."""
_CHALK = "#e4e9ee"
NIGHT_SCRIPT = f"""
const inks = ["{palette.INK[1:]}", "{_CHALK[1:]}"];
const dark = matchMedia("(prefers-color-scheme: dark)");
function paint() {{
  const colors = dark.matches ? [[0.13, 0.16, 0.20], [0.20, 0.24, 0.29]] : null;
  if (colors) ["top_color", "bottom_color"].forEach(
    (key, i) => viewer.set_property(["Background"], key, colors[i]));
  const [from, to] = dark.matches ? inks : [...inks].reverse();
  viewer.scene.traverse(part => {{
    for (const material of [part.material ?? []].flat())
      if (material.color?.getHexString() === from) material.color.set("#" + to);
  }});
}}
"""
"""Where the reader prefers dark pages, a dark background and what is drawn in ink in chalk: defines
`paint`, which is to be called once the scene has its own colours."""
_MARGIN = 1.06
_TURN, _ELEVATION = np.radians(25.0), np.radians(22.0)


X_WL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)
"""Pose of a camera in a scene that is about cameras: it looks along x, and z is up."""


def upright(model: SelfModel, robot: "ArmDescription | None" = None) -> NDArray:
    """Return the pose of a model's world in a scene whose z is up. Shape (4, 4).

    Only a model whose world is its left camera needs to be turned: others were measured by
    something that stood upright itself. Its robot knows how it stands; without one the camera is
    taken as level.

    Args:
        robot: The robot that the arm belongs to.

    Raises:
        ModelError: If the robot cannot be read, or its chain has other joints.
    """
    left = model.cameras.get("left")
    if left is None or not np.allclose(left.X_WC, np.eye(4), atol=1e-12):
        return np.eye(4)
    if robot is None or not model.has_arm:
        return X_WL
    X_WR = learned_frames(robot, model.chain).X_WR
    return transform(X_WR[:3, :3].T, np.zeros(3))


def turned(items: Iterable[Item], X_SW: NDArray) -> list[Item]:
    """Return items of a world in a scene.

    Args:
        items: As in the world.
        X_SW: Pose of the world in the scene. Shape (4, 4).
    """
    return [replace(item, X_WI=X_SW @ item.X_WI) for item in items]


def floor_items(points: NDArray, unit: float, X_SW: NDArray | None = None) -> list[Item]:
    """Return a grid whose lines lie at round coordinates, and W's axes where they are near.

    The grid lies at z = 0 where the data stand on it, else at a round height below them.

    Args:
        points: What stands on the floor [m]. Shape (N, 3).
        unit: Length that sizes are fractions of [m].
        X_SW: How the measuring frame W is turned in the scene; not at all if omitted. Shape (4, 4).

    Returns:
        Items under `floor`.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    size = float(np.linalg.norm(high - low))
    spacing = nice_below(max(size / 5.0, 1e-6))
    near = bool(np.all(low < _NEAR * size) and np.all(high > -_NEAR * size))
    if near:
        low, high = np.minimum(low, 0.0), np.maximum(high, 0.0)
    height = spacing * np.floor(low[2] / spacing)
    first = spacing * (np.floor(low[:2] / spacing) - 1.0)
    last = spacing * (np.ceil(high[:2] / spacing) + 1.0)
    starts, ends = _grid_lines(first, last, spacing, height)
    color = palette.rgba(palette.GRID)
    name = f"floor/grid_{1e3 * spacing:g}_mm_at_z_{1e3 * height:g}_mm"
    items: list[Item] = [Segments(path=name, color=color, starts=starts, ends=ends)]
    if near:
        white = (1.0, 1.0, 1.0, 1.0)
        length, radius = 0.25 * unit, 0.006 * unit
        pose = np.eye(4) if X_SW is None else X_SW
        path = "floor/measuring_frame"
        items.append(Triad(path=path, color=white, X_WI=pose, length=length, radius=radius))
    return items


def with_room(points: NDArray, room: float) -> NDArray:
    """Return what is that far from points along each axis: things are drawn about them.

    Args:
        points: Shape (N, 3).
        room: [m].

    Returns:
        Shape (6 N, 3).
    """
    return (points[:, None] + room * np.vstack([np.eye(3), -np.eye(3)])).reshape(-1, 3)


def camera_on(points: NDArray, front: NDArray) -> Camera:
    """Return a view that holds all points, about square to their widest horizontal spread.

    It looks down a little, from the side on which the foremost things are.

    Args:
        points: What must be seen [m]. Shape (N, 3).
        front: From what may be hidden to what should be in front of it. Shape (3,).
    """
    flat = points[:, :2] - points[:, :2].mean(axis=0)
    across = np.linalg.eigh(flat.T @ flat)[1][:, 0]
    # Both sides, each turned a little either way for depth.
    sides = np.arctan2(across[1], across[0]) + np.array([0.0, np.pi])
    azimuths = (sides[:, None] + np.array([-_TURN, _TURN])).ravel()
    azimuth = azimuths[np.argmax(np.cos(azimuths) * front[0] + np.sin(azimuths) * front[1])]
    return camera_from(points, float(azimuth))


def camera_from(points: NDArray, azimuth: float, elevation: float = _ELEVATION) -> Camera:
    """Return the nearest view from a direction that holds all points.

    Args:
        points: What must be seen [m]. Shape (N, 3).
        azimuth: Of the camera as seen from the points, from x towards y [rad].
        elevation: Of the camera as seen from the points [rad].
    """
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    away = np.cos(elevation) * np.array([right[1], -right[0], np.tan(elevation)])
    axes = np.stack([right, np.cross(away, right), away], axis=1)
    x, y, z = (points @ axes).T
    half = np.tan(0.5 * FIELD_OF_VIEW) * np.array([ASPECT, 1.0])
    # Seen from a distance d above c, a point is inside where |x - c| <= half * (d - z).
    above = np.array([np.max(s + h * z) for s, h in zip((x, y), half, strict=True)])
    below = np.array([np.max(h * z - s) for s, h in zip((x, y), half, strict=True)])
    height = float(np.max((above + below) / (2.0 * half)))
    middle = np.array([*(0.5 * (above - below)), 0.5 * (z.min() + z.max())])
    distance = max(height - middle[2], 1e-2)
    return Camera(axes @ middle + away * (_MARGIN * distance), axes @ middle)


def _grid_lines(
    first: NDArray, last: NDArray, spacing: float, height: float
) -> tuple[NDArray, NDArray]:
    """Return starts and ends of lines along x and along y. Two arrays of shape (k, 3)."""
    starts, ends = [], []
    for axis in (0, 1):
        other = 1 - axis
        count = round((last[other] - first[other]) / spacing)
        for k in range(count + 1):
            start, end = np.full(3, height), np.full(3, height)
            start[other] = end[other] = first[other] + k * spacing
            start[axis], end[axis] = first[axis], last[axis]
            starts.append(start)
            ends.append(end)
    return np.array(starts), np.array(ends)
