"""Screens beside a scene: what each camera sees, large and facing the viewer."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import apply, transform
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.photographs import jpeg
from nico_selfmodel.viz.scene.lettering import label
from nico_selfmodel.viz.scene.scene_items import Item, Picture, Tube

_WIDTH = 0.5
"""Of a screen, in heights of what it stands beside."""
_GAP = 0.06
"""Between screens, in their widths."""
_BELOW = 0.14
"""How far their upper edge is below the top of the scene, in heights of it: names go there."""
_WIRE = 0.006
"""Radius of a screen's frame, in its widths."""


@dataclass(frozen=True, eq=False)
class Screen:
    """An upright rectangle on which one camera's pictures are shown as they are, lens and all."""

    side: str
    """`left` or `right`."""
    X_WI: NDArray
    """Its middle; x to the viewer's right, y down, z away from the viewer. Shape (4, 4)."""
    width: float
    """[m]."""
    height: float
    """[m]."""

    @property
    def corners(self) -> NDArray:
        """Top left, top right, bottom right, bottom left [m]. Shape (4, 3)."""
        x, y = 0.5 * self.width, 0.5 * self.height
        return apply(self.X_WI, np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]))

    def frame_items(self) -> list[Item]:
        """Return its frame and its name, under `screens/<camera>`."""
        path, color = f"screens/{self.side}", palette.CAMERAS[self.side]
        above = self.X_WI @ transform(np.eye(3), [0.0, -0.52 * self.height, 0.0])
        words = f"{self.side} camera"
        return [
            Tube(
                path=f"{path}/frame",
                color=palette.rgba(color),
                points=self.corners,
                radius=_WIRE * self.width,
                closed=True,
            ),
            label(f"{path}/name", words, color, 0.13 * self.height, above, (0.5, 1.0)),
        ]

    def words(self, path: str, text: str, color: str, line: int) -> Item:
        """Return a line of words below the screen.

        Args:
            line: Its number, from 0.
        """
        down = (0.56 + 0.14 * line) * self.height
        left = self.X_WI @ transform(np.eye(3), [-0.5 * self.width, down, 0.0])
        return label(path, text, color, 0.11 * self.height, left, (0.0, 0.0))

    def picture(self, image: NDArray, path: str) -> Picture:
        """Return an image on the screen.

        Args:
            image: Red, green and blue, 8 bits. Shape (h, w, 3).
        """
        return Picture(
            path=path,
            color=(1.0,) * 4,
            X_WI=self.X_WI,
            width=self.width,
            height=self.height,
            image=jpeg(image),
        )


def screens_beside(
    points: NDArray, azimuth: float, sizes: Mapping[str, tuple[int, int]]
) -> dict[str, Screen]:
    """Return a screen for each camera, in a row to the viewer's right of a scene.

    Args:
        points: The scene [m]. Shape (N, 3).
        azimuth: Of the viewer as seen from the scene, from x towards y [rad].
        sizes: Camera -> width and height of its images [px], in the order of the row.

    Returns:
        Camera -> screen.
    """
    right, down = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0]), np.array([0.0, 0.0, -1.0])
    R_WI = np.stack([right, down, np.cross(right, down)], axis=1)
    top, tall = points[:, 2].max(), np.ptp(points[:, 2])
    width = _WIDTH * tall
    middle = points.mean(axis=0)
    start = middle + right * (float(np.max((points - middle) @ right)) + _GAP * width)
    screens: dict[str, Screen] = {}
    for k, (side, (w, h)) in enumerate(sizes.items()):
        height = width * h / w
        p = start + right * (0.5 + k * (1.0 + _GAP)) * width
        p[2] = top - _BELOW * tall - 0.5 * height
        screens[side] = Screen(side, transform(R_WI, p), width, height)
    return screens
