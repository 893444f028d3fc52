"""A mirror before a robot at work: what the glass shows, and the hand's reflection behind it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.viz.figures import palette
from nico_selfmodel.viz.scene.mirror_picture import on_glass, plate_items
from nico_selfmodel.viz.scene.scene_items import Item, Picture, Tube

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

    def __init__(self, glass: StandingGlass, plane: Plane) -> None:
        """Take a mirror.

        Args:
            glass: Where somebody put it.
            plane: Where it was learned to be, in the robot's root link.
        """
        self.plane = plane
        middle = glass.X_RM[:3, 3] - plane.distance_to(glass.X_RM[:3, 3]) * plane.normal
        right = glass.X_RM[:3, 0] - (glass.X_RM[:3, 0] @ plane.normal) * plane.normal
        right = 0.5 * glass.width * right / np.linalg.norm(right)
        down = np.cross(right, plane.normal) * glass.height / glass.width
        self.corners = middle + np.array(
            [down - right, down + right, right - down, -right - down], dtype=float
        )

    def frame_items(self) -> list[Item]:
        """Return the glass and its edge."""
        glass = self.corners - _BACK * self.plane.normal
        return plate_items("mirror", self.corners, glass, _GLASS, _EDGE)

    def reflection(self, p_RH: NDArray) -> NDArray:
        """Return where the reflection of a point appears, behind the glass. Shape (3,)."""
        return reflect(self.plane, p_RH)

    def project(self, rig: StereoRig, p_RQ: NDArray) -> NDArray:
        """Return where both cameras see the reflections of points [px]. (..., 3) -> (..., 4).

        They are nan behind the glass, and where a camera does not see them.
        """
        before = self.plane.distance_to(p_RQ) > 0.0
        return np.where(before[..., None], rig.project(reflect(self.plane, p_RQ)), np.nan)

    def picture(self, camera: Camera, image: NDArray) -> Picture:
        """Return on the glass what the left camera sees there.

        Args:
            camera: The left camera where it is.
            image: What it sees; red, green, blue, 8 bits. Shape (h, w, 3).
        """
        return on_glass("mirror/picture", camera, self.corners, image)

    def rays(self, rig: StereoRig, p_RH: NDArray, of: str = "mirror") -> dict[str, Item | None]:
        """Return how light goes from the hand over the glass into each camera that sees it.

        Args:
            rig: The cameras where they are.
            p_RH: The hand, as predicted. Shape (3,).
            of: Where the items belong.

        Returns:
            Path -> item: of each camera the way of the light, and where it seems to come from; None
            of one that does not see it.
        """
        expected, behind = self.project(rig, p_RH), self.reflection(p_RH)
        found: dict[str, Item | None] = {}
        for k, (side, camera) in enumerate(zip(SIDES, rig.cameras, strict=True)):
            seen = bool(np.isfinite(expected[2 * k : 2 * k + 2]).all())
            center = camera.X_WC[:3, 3]
            on = self.plane.met_between(center, behind) if seen else center
            for name, points, radius, opacity in (
                (f"{side}_ray", np.stack([p_RH, on, center]), _RAY, 1.0),
                (f"{side}_behind", np.stack([on, behind]), _BEHIND_RAY, 0.5),
            ):
                color, path = palette.rgba(palette.CAMERAS[side], opacity), f"{of}/{name}"
                tube = Tube(path=path, color=color, points=points, radius=radius)
                found[path] = tube if seen else None
        return found
