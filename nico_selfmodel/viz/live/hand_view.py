"""Hands at work before two cameras: in space as tracked and as predicted, and in the pictures."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.rgba import Rgba
from nico_selfmodel.viz.live.moving_scene import MovingScene
from nico_selfmodel.viz.live.screens import Screen
from nico_selfmodel.viz.live.station_mirror import StationMirror
from nico_selfmodel.viz.scene.scene import LegendEntry
from nico_selfmodel.viz.scene.scene_items import Item, Markers

CYAN, ORANGE = "#33bbee", "#ee7733"
TRACKED, PREDICTED = palette.rgba(CYAN), palette.rgba(ORANGE)
LEGEND = (LegendEntry("hand as tracked", TRACKED), LegendEntry("hand as predicted", PREDICTED))
AZIMUTH = np.radians(252.0)
"""The first view is from the robot's right and a little behind: it looks towards its screens."""

Marks = Mapping[Rgba, NDArray]
"""Colour -> pixels of both cameras, nan for none [px]. Shape (4,)."""


_MARK, _GAP, _THICK = 44, 18, 2
"""Half a cross, the hole in its middle, and half its thickness, in images [px]."""
_RING, _ARC = 26, np.tan(np.radians(21.0))
"""Radius of a ring in images [px], and the tangent of half the angle of its arcs."""


def hand_items(path: str, radius: float) -> list[Item]:
    """Return what marks a hand or its reflection as tracked and as predicted, below a path.

    Args:
        path: Of both.
        radius: Of the larger [m].
    """
    return [
        Markers(path=f"{path}/{kind}", color=color, centers=np.zeros((1, 3)), radius=size * radius)
        for kind, color, size in (("tracked", TRACKED, 1.0), ("predicted", PREDICTED, 0.8))
    ]


class HandView(MovingScene):
    """A body that moves, with screens for what its cameras see, and a glass or none before it."""

    _screens: dict[str, Screen]
    _mirror: StationMirror | None

    def _show_hand(
        self, path: str, rig: StereoRig, tracked: NDArray, at: NDArray, time: float | None
    ) -> None:
        """Show a hand, or its reflection, where it is seen and where it is expected."""
        seen = rig.triangulate(tracked[None]).p_WQ[0]
        for kind, p in (("tracked", seen), ("predicted", at)):
            known = bool(np.isfinite(p).all())
            if known:
                self._place(f"{path}/{kind}", transform(np.eye(3), p), time)
            self._set_visible(f"{path}/{kind}", known, time)

    def _show_reflection(
        self,
        path: str,
        rig: StereoRig,
        tracked: NDArray,
        at: NDArray,
        rays: str,
        time: float | None,
    ) -> None:
        """Show where a hand's reflection is seen and expected, and below `rays` its light."""
        if self._mirror is None:
            return
        in_front = float(self._mirror.plane.distance_to(at)) > 0.0
        behind = self._mirror.reflection(at) if in_front else np.full(3, np.nan)
        self._show_hand(path, rig, tracked, behind, time)
        for name, item in self._mirror.rays(rig, at, rays).items():
            self._show_item(name, item, time)

    def _show_images(
        self,
        rig: StereoRig,
        images: Sequence[NDArray],
        marks: Iterable[tuple[Marks, Marks]],
        time: float | None,
    ) -> None:
        """Show both pictures (BGR), and what the glass shows, with crosses and rings of hands."""
        drawn = [image[:, :, ::-1] for image in images]
        if self._mirror is not None:
            self._show_item("mirror/picture", self._mirror.picture(rig.left, drawn[0]), time)
        for crosses, rings in marks:
            for k in range(len(drawn)):
                own = slice(2 * k, 2 * k + 2)
                both = ({color: uv[own] for color, uv in m.items()} for m in (crosses, rings))
                drawn[k] = marked(drawn[k], *both)
        for side, image in zip(self._screens, drawn, strict=True):
            self._show_image(side, image, time)

    def _show_image(self, side: str, image: NDArray, time: float | None) -> None:
        """Draw an image (red, green, blue) on its screen."""
        self._show_item(f"screens/{side}/image", self._screens[side].picture(image, "image"), time)


def marked(
    image: NDArray,
    marks: Mapping[Rgba, ArrayLike],
    rings: Mapping[Rgba, ArrayLike] = MappingProxyType({}),
) -> NDArray:
    """Return an image with a cross at each mark, open in the middle, and with rings.

    Args:
        image: Red, green, blue, 8 bits. Shape (h, w, 3).
        marks: Colour -> pixel (u, v); nan for none.
        rings: The same of what is marked by a ring.

    Returns:
        A copy. Shape (h, w, 3).
    """
    drawn = np.array(image)
    v, u = np.ogrid[: drawn.shape[0], : drawn.shape[1]]
    for shape, places in ((_cross, marks), (_ring, rings)):
        for turn, (color, pixel) in enumerate(places.items()):
            at = np.asarray(pixel, dtype=float)
            if not np.isfinite(at).all():
                continue
            x, y = u - round(at[0]), v - round(at[1])
            # Every other mark stands on its corner, so that both show where they coincide.
            x, y = (x, y) if turn % 2 == 0 else (x + y, x - y)
            drawn[shape(x, y, turn % 2)] = np.round(255.0 * np.array(color[:3])).astype(np.uint8)
    return drawn


def _cross(x: NDArray, y: NDArray, _turned: int) -> NDArray:
    """Return the pixels of a cross that is open in the middle."""
    far = np.maximum(np.abs(x), np.abs(y))
    return (np.minimum(np.abs(x), np.abs(y)) <= _THICK) & (far <= _MARK) & (far >= _GAP)


def _ring(x: NDArray, y: NDArray, turned: int) -> NDArray:
    """Return the pixels of a ring's four arcs about the axes; turned axes are longer by root 2."""
    radius = np.hypot(x, y) / np.sqrt(1.0 + turned)
    near_axis = np.minimum(np.abs(x), np.abs(y)) < _ARC * np.maximum(np.abs(x), np.abs(y))
    return (np.abs(radius - _RING) <= _THICK) & near_axis
