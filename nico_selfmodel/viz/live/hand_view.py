"""Hands at work before two cameras: in space as tracked and as predicted, and in the pictures."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.figures.rgba import Rgba
from nico_selfmodel.viz.live.image_marks import marked
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
