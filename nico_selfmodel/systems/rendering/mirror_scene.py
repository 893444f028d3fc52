"""Mirrors in the simulated world, and what rendered cameras see in them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import (
    Box,
    FrameId,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    IllustrationProperties,
    QueryObject,
    Rgba,
    SceneGraph,
    SourceId,
)
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem, System

from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.systems.rendering.cropped_render import CroppedRender
from nico_selfmodel.vision.images.faulty_glass import bent_picture, picture_at, stained, stains_on
from nico_selfmodel.vision.images.mirror_glass import GlassInView

AWAY = RigidTransform(p=[0.0, 0.0, -60.0])
"""Pose of a mirror that nobody has put anywhere."""
_THICK = 0.004
_GLASS = (0.62, 0.72, 0.80, 1.0)
_VIEWER = 0.45
"""How far before a screen who sees in it what a mirror would show is [m]."""
_DOT = 5e-4
"""Side of a screen's pixel [m]."""
_RIM, _BACK = (70, 74, 78, 255), (110, 104, 96, 255)
"""Red, green, blue, opacity of what is around the glass and on its back."""


@dataclass(frozen=True)
class MirrorPlate:
    """A mirror as it can be bought, flat and clean or not.

    In its frame M, in the middle of the glass, x is right and y down for whoever looks into it.
    """

    name: str = "mirror"
    """What it is called."""
    width: float = 0.40
    """Of the glass [m]."""
    height: float = 0.30
    """Of the glass [m]."""
    rim: float = 0.006
    """Width of the dark rim around the glass [m]."""
    radius: float | None = None
    """Of curvature about its middle [m], positive where it bulges towards whoever looks into it;
    None if it is flat."""
    dirt: float = 0.0
    """What stains show of themselves where they are thickest, as a share of what is seen there."""
    live: bool = False
    """A screen instead, that shows live what who stands before its middle would see in a mirror."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        if not (self.width > 0.0 and self.height > 0.0 and self.rim >= 0.0):
            raise ValueError(
                "width and height must be positive and the rim not negative, got "
                f"{self.width}, {self.height} and {self.rim} m"
            )
        if self.radius is not None and not abs(self.radius) > float(
            np.hypot(self.width, self.height)
        ):
            raise ValueError(
                "the radius of a bent mirror must be longer than its diagonal of "
                f"{np.hypot(self.width, self.height):.3g} m, got {self.radius} m"
            )
        if self.live and (self.radius is not None or self.dirt):
            raise ValueError("a screen is flat and clean: give no radius and no dirt")
        if not 0.0 <= self.dirt <= 1.0:
            raise ValueError(f"dirt must be a share between 0 and 1, got {self.dirt}")


class MirrorScene(LeafSystem):
    """Mirrors that somebody can put anywhere in a scene graph.

    | port | | carries |
    |---|---|---|
    | `<name>_pose` | in | pose X_WM of that mirror, a `RigidTransform`; away if not connected |
    | `geometry_pose` | out | poses of all mirrors for the scene graph |

    Renderers know nothing of the glass: `StereoCameras` that are given `self.glasses` work out what
    it shows. Other mirrors are not seen in a mirror.
    """

    def __init__(self, scene_graph: SceneGraph, plates: Sequence[MirrorPlate]) -> None:
        """Make the mirrors, all of them put away.

        Args:
            scene_graph: Where they shall stand.

        Raises:
            ValueError: If there is none, or two have one name.
        """
        super().__init__()
        names = [plate.name for plate in plates]
        if not names or len(set(names)) < len(names):
            raise ValueError(f"mirrors must have different names, got {names}")
        self.source: SourceId = scene_graph.RegisterSource("mirrors")
        self.glasses: tuple[Glass, ...] = tuple(
            Glass(plate, _registered(scene_graph, self.source, plate)) for plate in plates
        )
        still = AbstractValue.Make(RigidTransform())
        self._poses = [self.DeclareAbstractInputPort(f"{name}_pose", still) for name in names]
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            self._tell,
            {port.ticket() for port in self._poses},
        )

    def _tell(self, context: Context, value: AbstractValue) -> None:
        poses = FramePoseVector()
        for glass, port in zip(self.glasses, self._poses, strict=True):
            pose = port.Eval(context) if port.HasValue(context) else AWAY
            poses.set_value(glass.frame, pose)
        value.set_value(poses)


def put_mirror(station: System, context: Context, X_BM: NDArray | None) -> None:
    """Put the mirror of a station somewhere, through its port `mirror_pose`.

    Args:
        station: With such a port, as `NicoStation` has it.
        X_BM: Pose of the glass in the frame of the arm's base; None puts it away. Shape (4, 4).
    """
    pose = AWAY if X_BM is None else RigidTransform(pose=np.asarray(X_BM, dtype=float))
    station.GetInputPort("mirror_pose").FixValue(context, AbstractValue.Make(pose))


@dataclass(frozen=True, eq=False)
class Glass:
    """A mirror as cameras find it in a scene graph."""

    plate: MirrorPlate
    """What it is."""
    frame: FrameId
    """Its frame M."""

    def show(
        self,
        query: QueryObject,
        camera: CroppedRender,
        X_WC: NDArray,
        seen: NDArray,
        depth: NDArray,
    ) -> None:
        """Put what is seen of this mirror into what a pinhole camera sees of all else.

        Args:
            X_WC: Its pose. Shape (4, 4).
            seen: Its picture, red, green, blue, opacity; changed in place. Shape (h, w, 4).
            depth: Distances of what it sees [m], changed in place. Shape (h, w).
        """
        plate = self.plate
        X_WM = query.GetPoseInWorld(self.frame).GetAsMatrix4()
        X_CM, outer = inverse(X_WC) @ X_WM, self._outer(query, camera, X_WC)
        if outer is None:
            return
        outer.show(seen, depth, _RIM if outer.faces_camera else _BACK, None)
        glass = GlassInView.of(camera.K, camera.size, X_CM, (plate.width, plate.height))
        if glass is None or not glass.faces_camera:
            return
        K, size = glass.twin
        X_WV = RigidTransform(pose=X_WM @ glass.X_MV)
        world = query.inspector().world_frame_id()
        twin = CroppedRender(camera.renderer, size, K, world, X_WV, near=glass.distance)
        if plate.live:
            shown = self._on_screen(query, camera, glass, (size[1], size[0]))
        elif plate.radius is None:
            shown = twin(query)
        else:
            shown = bent_picture(*twin.with_depth(query), glass, plate.radius)
        if plate.dirt:
            shown = stained(shown, glass, self.stains, plate.dirt)
        glass.show(seen, depth, shown, K)

    def in_view(self, query: QueryObject, camera: CroppedRender, X_WC: NDArray) -> bool:
        """Return whether a pinhole camera at a pose X_WC has it in view. Shape (4, 4)."""
        return self._outer(query, camera, X_WC) is not None

    def _outer(
        self, query: QueryObject, camera: CroppedRender, X_WC: NDArray
    ) -> GlassInView | None:
        plate = self.plate
        X_CM = inverse(X_WC) @ query.GetPoseInWorld(self.frame).GetAsMatrix4()
        around = (plate.width + 2.0 * plate.rim, plate.height + 2.0 * plate.rim)
        return GlassInView.of(camera.K, camera.size, X_CM, around)

    def _on_screen(
        self, query: QueryObject, camera: CroppedRender, glass: GlassInView, shape: tuple[int, int]
    ) -> NDArray:
        """Return what the glass would have to show a camera for a live picture to lie on it.

        Args:
            glass: As it has it in view.
            shape: Of the picture of its twin (h, w).
        """
        plate = self.plate
        X_CM = RigidTransform(p=[0.0, 0.0, _VIEWER]).GetAsMatrix4()
        size = (round(plate.width / _DOT), round(plate.height / _DOT))
        K = np.array([[_VIEWER / _DOT, 0.0, 0.5 * size[0]], [0.0, _VIEWER / _DOT, 0.5 * size[1]],
                      [0.0, 0.0, 1.0]])  # fmt: skip
        screen = GlassInView.of(K, size, X_CM, (plate.width, plate.height))
        assert screen is not None, "who stands before the middle of a screen has it in view"
        K, size = screen.twin
        X_WV = RigidTransform(pose=query.GetPoseInWorld(self.frame).GetAsMatrix4() @ screen.X_MV)
        world = query.inspector().world_frame_id()
        twin = CroppedRender(camera.renderer, size, K, world, X_WV, near=_VIEWER)
        return picture_at(twin(query), screen.pixels(glass.places(shape)))

    @cached_property
    def stains(self) -> NDArray:
        """How thick stains lie on the glass, of the thickest, a pixel each 5 mm. Shape (h, w)."""
        return stains_on((self.plate.width, self.plate.height))


def show_mirrors(
    query: QueryObject, camera: CroppedRender, glasses: Sequence[Glass], X_WC: NDArray
) -> NDArray:
    """Render what a pinhole camera sees, mirrors included.

    Args:
        glasses: The mirrors, in any order: the nearer one hides the other.
        X_WC: Pose of the camera. Shape (4, 4).

    Returns:
        Red, green, blue, opacity, 8 bits. Shape (h, w, 4).
    """
    seen, depth = camera.with_depth(query)
    for glass in glasses:
        glass.show(query, camera, X_WC, seen, depth)
    camera.emptied(query)
    return seen


def _registered(scene_graph: SceneGraph, source: SourceId, plate: MirrorPlate) -> FrameId:
    """Register a frame with a plate that viewers draw and renderers do not."""
    frame = scene_graph.RegisterFrame(source, GeometryFrame(plate.name))
    behind = RigidTransform(p=np.array([0.0, 0.0, 0.5 * _THICK]))
    shape = GeometryInstance(behind, Box(plate.width, plate.height, _THICK), f"{plate.name}_glass")
    properties = IllustrationProperties()
    properties.AddProperty("phong", "diffuse", Rgba(*_GLASS))
    shape.set_illustration_properties(properties)
    scene_graph.RegisterGeometry(source, frame, shape)
    return frame
