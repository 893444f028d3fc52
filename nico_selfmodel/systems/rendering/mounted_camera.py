"""One camera in a scene graph: what a pinhole sees there, bent by a lens."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import FrameId, QueryObject
from pydrake.math import RigidTransform

from nico_selfmodel.errors import RobotError
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.systems.rendering.cropped_render import CroppedRender
from nico_selfmodel.systems.rendering.mirror_scene import Glass, show_mirrors
from nico_selfmodel.vision.images.image_array import bgr_of_rgba
from nico_selfmodel.vision.images.lens_warp import LensWarp


@dataclass(frozen=True, eq=False)
class Sight:
    """A ball that somebody looks at."""

    frame: FrameId
    """What it is fixed to in the scene graph."""
    p_FS: NDArray
    """Its middle there [m]. Shape (3,)."""
    radius: float
    """[m]."""


@dataclass(frozen=True, eq=False)
class Look:
    """What a camera sees of a sight."""

    pixels: tuple[slice, slice]
    """Rows and columns around it in the camera's picture."""
    shown: NDArray
    """Which of them look at it. Boolean, shape (rows, columns)."""
    light: NDArray
    """Red, green, blue, opacity, 8 bits. Shape (rows, columns, 4)."""


class MountedCamera:
    """One camera and its lens."""

    def __init__(
        self,
        camera: Camera,
        frame: FrameId,
        supersample: int,
        renderer: str,
        glasses: Sequence[Glass] = (),
        sights: Sequence[Sight] = (),
        background: Sequence[float] = (0.0, 0.0, 0.0),
        *,
        turns: bool = True,
    ) -> None:
        """Mount the camera.

        Args:
            camera: Its `X_WC` is its pose in the frame.
            frame: What it is mounted on.
            supersample: Rendered samples along each side of a pixel.
            renderer: Name of the renderer in the scene graph.
            sights: What is looked at closely.
            background: Red, green, blue of the renderer where nothing is, of 1.
            turns: Whether a part of a picture may be rendered turned (`CroppedRender.turns`).

        Raises:
            ModelError: If the lens sees too wide to be rendered.
        """
        self._warp = _lens_warp(
            tuple(camera.values.tolist()), camera.image_size, camera.lens, supersample
        )
        X_FC = RigidTransform(pose=camera.X_WC)
        warp = self._warp
        self._pinhole = CroppedRender(
            renderer, warp.render_size, warp.render_K, frame, X_FC, turns=turns
        )
        self._glasses, self._sights = tuple(glasses), tuple(sights)
        self._background = np.rint(255.0 * np.array([*background, 1.0])).astype(np.uint8)

    def render(self, query: QueryObject, looks: Sequence[Look] = ()) -> NDArray:
        """Return the bent picture. BGR, shape (h, w, 3).

        Args:
            looks: What `look` returned of the same scene, for the picture to show it to the bit.

        Raises:
            RobotError: If the scene graph has no such renderer.
        """
        pinhole = self._pinhole
        try:
            X_WC = (query.GetPoseInWorld(pinhole.frame) @ pinhole.X_FC).GetAsMatrix4()
            if any(glass.in_view(query, pinhole, X_WC) for glass in self._glasses):
                seen = show_mirrors(query, pinhole, self._glasses, X_WC)
                return bgr_of_rgba(self._warp.apply(seen))
            part = pinhole.part(query)
        except RuntimeError as error:
            raise self._unable(error) from error
        bent = self._warp.apply_to_part(part.picture, part.window, part.color, part.H)
        return _with_looks(bent, looks)

    def look(self, query: QueryObject) -> tuple[Look, ...]:
        """Render what is about the sights in view, each by a camera that is turned there.

        Raises:
            RobotError: If the scene graph has no such renderer.
        """
        pinhole, warp, looks = self._pinhole, self._warp, []
        for sight in self._sights:
            cone = pinhole.cone_about(query, sight.frame, sight.p_FS, sight.radius)
            found = warp.region_in(*cone)
            if found is None:
                continue
            region, shown = found
            rays = warp.rays_of(region, shown)
            if not len(rays):
                continue
            try:
                rendered, H = pinhole.turned_to(query, rays)
            except RuntimeError as error:
                raise self._unable(error) from error
            looks.append(Look(region.pixels, shown, warp.bend_region(rendered, region, H)))
        return tuple(looks)

    def only(self, looks: Sequence[Look]) -> NDArray:
        """Return a plain picture of the background that shows looks. BGR, shape (h, w, 3)."""
        return _with_looks(self._warp.plain(self._background).copy(), looks)

    def _unable(self, error: RuntimeError) -> RobotError:
        return RobotError(
            f"the cameras cannot render with {self._pinhole.renderer!r}: "
            f"{' '.join(str(error).split())}"
        )


def _with_looks(bent: NDArray, looks: Sequence[Look]) -> NDArray:
    """Put looks into a bent picture. RGBA -> BGR."""
    for look in looks:
        bent[look.pixels][look.shown] = look.light[look.shown]
    return bgr_of_rgba(bent)


@lru_cache(maxsize=2)
def _lens_warp(
    values: tuple[float, ...], image_size: tuple[int, int], lens: str, supersample: int
) -> LensWarp:
    """Prepare a lens; stations of one robot share it."""
    return LensWarp.from_camera(Camera.from_values(values, image_size, lens=lens), supersample)
