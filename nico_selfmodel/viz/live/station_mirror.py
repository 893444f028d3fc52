"""A mirror before a robot at work: what the glass shows, and the hand's reflection behind it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.mirror_picture import on_glass
from nico_selfmodel.viz.scene.scene_items import Item, Picture, Surface, Tube

_EDGE, _RAY, _BEHIND_RAY = 0.003, 0.0014, 0.0007
"""Radii of what is drawn [m]."""
_GLASS = palette.rgba("#8fb4d9")
_BACK = 0.002
"""How far behind its picture the glass is drawn [m]."""


@dataclass(frozen=True, eq=False)
class StandingGlass:
    """A mirror that somebody has put before a robot."""

    mirror: str
    """What the self-model calls it."""
    X_RM: NDArray
    """About where the middle of the glass is in the robot's root link, x to the right and y down
    for whoever looks into it. The plane itself is the self-model's. Shape (4, 4)."""
    width: float
    """[m]."""
    height: float
    """[m]."""


class StationMirror:
    """The items of one mirror before a robot; those of one moment are made anew for each."""

    def __init__(self, glass: StandingGlass, model: SelfModel) -> None:
        """Take a mirror.

        Args:
            glass: Where somebody put it.
            model: Arm, cameras and mirror, in the robot's root link.

        Raises:
            ModelError: If the model does not know that mirror.
        """
        self.rig = model.mirror_rig(glass.mirror)
        normal = self.rig.plane.normal
        middle = glass.X_RM[:3, 3] - self.rig.plane.distance_to(glass.X_RM[:3, 3]) * normal
        right = glass.X_RM[:3, 0] - (glass.X_RM[:3, 0] @ normal) * normal
        right = 0.5 * glass.width * right / np.linalg.norm(right)
        down = np.cross(right, normal) * glass.height / glass.width
        self.corners = middle + np.array(
            [down - right, down + right, right - down, -right - down], dtype=float
        )

    def frame_items(self) -> list[Item]:
        """Return the glass and its edge."""
        return [
            Surface(
                path="mirror/glass",
                color=_GLASS,
                vertices=self.corners - _BACK * self.rig.plane.normal,
                faces=np.array([[0, 1, 2], [0, 2, 3]]),
            ),
            Tube(
                path="mirror/edge",
                color=palette.rgba(palette.MUTED),
                points=self.corners,
                radius=_EDGE,
                closed=True,
            ),
        ]

    def reflection(self, p_RH: NDArray) -> NDArray:
        """Return where the reflection of a point appears, behind the glass. Shape (3,)."""
        return reflect(self.rig.plane, p_RH)

    def picture(self, image: NDArray) -> Picture:
        """Return on the glass what the left camera sees there.

        Args:
            image: Of the left camera, red, green, blue, 8 bits. Shape (h, w, 3).
        """
        return on_glass("mirror/picture", self.rig.rig.left, self.corners, image)

    def rays(self, p_RH: NDArray) -> dict[str, Item]:
        """Return how light goes from the hand over the glass into each camera that sees it.

        Args:
            p_RH: The hand, as predicted. Shape (3,).

        Returns:
            Name -> item: of each camera the way of the light, and where it seems to come from.
        """
        expected, found = self.rig.project(p_RH), {}
        behind = self.reflection(p_RH)
        for k, (side, camera) in enumerate(zip(SIDES, self.rig.rig.cameras, strict=True)):
            if not np.isfinite(expected[2 * k : 2 * k + 2]).all():
                continue
            center = camera.X_WC[:3, 3]
            near, far = self.rig.plane.distance_to(center), self.rig.plane.distance_to(behind)
            on = center + near / (near - far) * (behind - center)
            for name, points, radius, opacity in (
                (f"{side}_ray", np.stack([p_RH, on, center]), _RAY, 1.0),
                (f"{side}_behind", np.stack([on, behind]), _BEHIND_RAY, 0.5),
            ):
                color = palette.rgba(palette.CAMERAS[side], opacity)
                found[name] = Tube(path=f"mirror/{name}", color=color, points=points, radius=radius)
        return found
