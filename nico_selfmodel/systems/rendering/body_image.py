"""What a robot expects to see of itself, directly or in a mirror."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import RenderLabel
from pydrake.math import RigidTransform
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem
from pydrake.systems.sensors import ImageDepth32F, ImageLabel16I

from nico_selfmodel.arrays import frozen_array
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.reflection import reflection
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.plant.link_surfaces import link_surfaces
from nico_selfmodel.systems.closing import Closable, free_memory
from nico_selfmodel.systems.image_values import image_value
from nico_selfmodel.systems.rendering.cropped_render import CroppedRender, LabelledPicture
from nico_selfmodel.systems.rendering.paints import painted, repaint, tell_apart
from nico_selfmodel.systems.rendering.station_scene import add_renderer, remove_scene
from nico_selfmodel.systems.rendering.stereo_cameras import RENDERER
from nico_selfmodel.vision.images.lens_warp import LensWarp

NOTHING = int(RenderLabel.kEmpty)
"""Label of pixels that show nothing of the body."""
_TURNED = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class ExpectedPicture(LabelledPicture):
    """What a camera is expected to see of a body."""

    paints: NDArray
    """Which of the body's paints is seen; -1 where nothing is, or none of them. Shape (h, w)."""


@dataclass(frozen=True, eq=False)
class StandingJoint:
    """A joint that nobody commands, and where it stands."""

    name: str
    """Of the joint."""
    angle: float
    """[rad]."""
    axis: NDArray
    """Direction about which it turns, in the model's world. Shape (3,)."""
    p_WJ: NDArray
    """A point of that axis [m]. Shape (3,)."""
    links: frozenset[str]
    """Links beyond it."""


class BodyImage(Closable, LeafSystem):
    """The pictures that both cameras should take of the own body.

    | port | | carries |
    |---|---|---|
    | `encoders` | in | what the encoders read [encoder units] |
    | `mirror` | in | the `Mirror` that is looked into; not connected, or None: none |
    | `left_image_expected`, `right_image_expected` | out | pictures, `ImageRgba8U` |
    | `left_depth`, `right_depth` | out | distance along the optical axis, `ImageDepth32F` |
    | `left_link`, `right_link` | out | which of `links` is seen, or `NOTHING`, `ImageLabel16I` |

    Depths are in metres, inf where nothing of the body is; those of a reflection go through the
    glass, to where it seems to be. The arm stands as it was learned; all other links and all shapes
    are those of the robot's description, colours too unless it is painted, and the light is the
    simulated room's, which stands as the robot does unless it is turned. A
    mirror shows the body as the reflected camera sees it (`mirror_camera`), and what of the body is
    before the glass hides it; the glass is taken to be as large as the picture. How it stands, its
    paints and the light are the system's, not a context's: all contexts share them, and a port that
    was evaluated shows what they were until `encoders` or `mirror` change. Close it after use:
    its renderer takes 50 MB.

    Raises:
        RobotError: From its methods, if it was closed.
    """

    def __init__(self, arm: ArmDescription, model: SelfModel, *, supersample: int = 2) -> None:
        """Take a learned body.

        Args:
            arm: Which robot it is.
            model: What it has learned of arm and cameras.
            supersample: Rendered samples along each side of a pixel.

        Raises:
            ModelError: If the model has other joints, or no pair of cameras.
            RobotError: If nothing can be rendered here.
        """
        super().__init__()
        builder = DiagramBuilder()
        self._built = SelfModelPlant.from_urdf(arm, model, builder=builder)
        scene = self._built.scene_graph
        assert scene is not None
        diagram: Any = builder.Build()
        self.__diagram, self.__scene, self.__context = (
            diagram,
            scene,
            diagram.CreateDefaultContext(),
        )
        plant, own = self._built.plant, self._built.own_context(self.__context)
        root = plant.GetBodyByName(arm.links.root_link, self._built.instance)
        self._R_WR = plant.EvalBodyPoseInWorld(own, root).rotation().matrix()
        self._turn = np.zeros(3)
        numbers = [int(body) for body in plant.GetBodyIndices(self._built.instance)]
        self._stride = max(numbers) + 1
        self._painted = painted(scene, self._built)
        self.paints = tell_apart(scene, self._built, self._painted, self._stride)
        """Red, green and blue of all paints by the description, of 1. Shape (K, 3)."""
        self.colors = self.paints
        """The same as they were learned. Shape (K, 3)."""
        self.paint_sigma = np.zeros(len(self.paints))
        """What each is not known by, as a share. Shape (K,)."""
        add_renderer(scene, glare=True, R_WR=self._R_WR)
        self.__context = diagram.CreateDefaultContext()  # which knows the renderer
        scene.RemoveRenderer(RENDERER)  # of further contexts, which nobody makes
        self._cameras = model.rig.cameras
        self._warps = [  # without what only cameras need that are turned
            replace(LensWarp.from_camera(camera, supersample), rays=np.empty((0, 0, 2)))
            for camera in self._cameras
        ]
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self._built.instance)]
        self.links = {int(body.index()): body.name() for body in bodies}
        """Number in the pictures of links -> name of the link."""
        self.moving = frozenset(_beyond(self._built, arm.joints[0]))
        """Numbers of the links that the arm moves."""
        self.joints = arm.joints
        """Names of the arm's joints; the first carries the whole arm."""
        self.surfaces = {
            name: surface
            for name, surface in link_surfaces(scene, self._built).items()
            if name in self.links.values()
        }
        """Link -> its surface by the description, where that is made of simple solids."""
        self._encoders = self.DeclareVectorInputPort("encoders", len(arm.joints))
        self._mirror = self.DeclareAbstractInputPort("mirror", AbstractValue.Make(object()))
        self._X_WB = np.eye(4)
        self._described = self.surfaces
        self._last: list[tuple[bytes, ExpectedPicture] | None] = [None, None]
        for k, side in enumerate(SIDES):
            self._declare(f"{side}_image_expected", k, image_value, "color")
            self._declare(f"{side}_depth", k, _depth_value, "depth")
            self._declare(f"{side}_link", k, _link_value, "labels")

    def _declare(self, name: str, k: int, make: Callable[..., AbstractValue], part: str) -> None:
        """Declare a port that carries one part of what a camera is expected to see."""

        def calc(context: Context, value: Any) -> None:
            readings = np.array(self._encoders.Eval(context), dtype=float)
            found: Any = self._mirror.Eval(context) if self._mirror.HasValue(context) else None
            seen = self.expect(readings, found if isinstance(found, Mirror) else None, k)
            data = np.asarray(value.get_mutable_value().mutable_data)
            data[:] = getattr(seen, part).reshape(data.shape)

        size = self._cameras[k].image_size
        needs = {self._encoders.ticket(), self._mirror.ticket()}
        self.DeclareAbstractOutputPort(name, lambda: make(*size), calc, needs)

    def expect(self, readings: ArrayLike, mirror: Mirror | None, side: int) -> ExpectedPicture:
        """Return what a camera is expected to see; the same look again is not rendered anew.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).
            mirror: What is looked into, if anything.
            side: The camera, 0 (left) or 1.

        Raises:
            ValueError: If the readings are not n numbers.
        """
        self.require_open()
        readings = np.asarray(readings, dtype=float)
        known = readings.tobytes() + (b"" if mirror is None else mirror.values.tobytes())
        self._built.set_positions(self.__context, readings)
        last = self._last[side]
        if last is None or last[0] != known:
            last = self._last[side] = known, self._bent(side, mirror)
        return last[1]

    def hold(self, angles: Mapping[str, float], X_WB: ArrayLike | None = None) -> None:
        """Let joints stand somewhere that nobody commands, and the whole body; all else stays.

        Args:
            angles: Joint -> angle [rad].
            X_WB: Where the whole body stands, of where the learned arm would have it. Shape (4, 4).
        """
        self.require_open()
        self._last = [None, None]
        if angles:
            self._built.move_joints(self.__context, angles, list(angles.values()))
        self._X_WB = np.eye(4) if X_WB is None else np.array(X_WB, dtype=float)

    def turn_light(self, turn: ArrayLike) -> None:
        """Let the light come from elsewhere than where the robot's root has it.

        Args:
            turn: Of the room's light about the robot, a rotation vector in the model's world [rad].
                Shape (3,).
        """
        self.require_open()
        if np.array_equal(turn, self._turn):
            return
        self._last = [None, None]
        self._turn = np.array(turn, dtype=float)
        context: Any = self.__scene.GetMyMutableContextFromRoot(self.__context)
        turned = rotation_from_vector(turn) @ self._R_WR
        add_renderer(self.__scene, glare=True, R_WR=turned, context=context)

    def paint(self, colors: ArrayLike, sigma: ArrayLike) -> None:
        """Let the paints have other colours than the description's.

        Args:
            colors: Of each of `paints`, of 1. Shape (K, 3).
            sigma: What it is not known by, as a share. Shape (K,).

        Raises:
            ValueError: If either has another shape, or a colour is not from 0 to 1.
        """
        self.require_open()
        colors = frozen_array(colors, self.paints.shape, "colors")
        if not ((colors >= 0.0) & (colors <= 1.0)).all():
            raise ValueError(
                f"colors must be from 0 to 1, got {colors.min():g} to {colors.max():g}"
            )
        self.paint_sigma = frozen_array(sigma, (len(colors),), "sigma")
        if np.array_equal(colors, self.colors):
            return
        self._last = [None, None]
        self.colors = colors
        each = zip(self.paints.tolist(), self.colors.tolist(), strict=True)
        new = {(*old,): (*one,) for old, one in each}
        context: Any = self.__scene.GetMyMutableContextFromRoot(self.__context)
        repaint(self.__scene, self._built, self._painted, new, context)
        self.surfaces = {link: one.recolored(new) for link, one in self._described.items()}

    @property
    def _X_BW(self) -> NDArray:
        return inverse(self._X_WB)

    def standing(self, joints: Sequence[str]) -> tuple[StandingJoint, ...]:
        """Return where joints that nobody commands stand, as they were told to last."""
        self.require_open()
        plant, own = self._built.plant, self._built.own_context(self.__context)
        found = []
        for name in joints:
            joint: Any = plant.GetJointByName(name, self._built.instance)
            X_WM = self._X_WB @ joint.frame_on_child().CalcPoseInWorld(own).GetAsMatrix4()
            axis = X_WM[:3, :3] @ joint.revolute_axis()
            beyond = frozenset(self.links[k] for k in _beyond(self._built, name))
            found.append(StandingJoint(name, joint.get_angle(own), axis, X_WM[:3, 3], beyond))
        return tuple(found)

    def poses(self, readings: ArrayLike) -> dict[str, NDArray]:
        """Return where all links are expected at readings of the encoders.

        Args:
            readings: [encoder units]. Shape (n,).

        Returns:
            Link -> its pose in the model's world. Shape (4, 4) each.

        Raises:
            ValueError: If the readings are not n numbers.
        """
        self.require_open()
        self._built.set_positions(self.__context, np.asarray(readings, dtype=float))
        plant, own = self._built.plant, self._built.own_context(self.__context)
        bodies = [(name, plant.get_body(BodyIndex(index))) for index, name in self.links.items()]
        X_WB = self._X_WB
        return {name: X_WB @ plant.EvalBodyPoseInWorld(own, b).GetAsMatrix4() for name, b in bodies}

    def _bent(self, k: int, mirror: Mirror | None) -> ExpectedPicture:
        """Render one camera's pictures and bend them by its lens."""
        context = self.__scene.GetMyContextFromRoot(self.__context)
        query = self.__scene.get_query_output_port().Eval(context)
        seen, warp = self._render(query, k, None), self._warps[k]
        if mirror is not None:
            plane = mirror.plane_in(self._X_BW @ self._cameras[0].X_WC)
            reflected = self._render(query, k, plane)
            before = seen.labels == NOTHING
            np.copyto(seen.color, reflected.color, where=before[:, :, None])
            np.copyto(seen.depth, reflected.depth, where=before)
            np.copyto(seen.labels, reflected.labels, where=before)
        labels = warp.nearest(seen.labels, NOTHING)
        body = labels != NOTHING
        return ExpectedPicture(
            warp.apply(seen.color),
            warp.nearest(seen.depth, np.inf),
            np.where(body, labels % self._stride, NOTHING),
            np.where(body, labels // self._stride - 1, -1),
        )

    def _render(self, query: Any, k: int, plane: Plane | None) -> LabelledPicture:
        """Render what a pinhole sees of the body, by a mirror if there is one.

        The reflected camera is left-handed, which no renderer takes: its x axis is turned round,
        and the picture then turned back.
        """
        warp, X_WC = self._warps[k], self._X_BW @ self._cameras[k].X_WC
        K = warp.render_K.copy()
        if plane is not None:
            X_WC = reflection(plane) @ X_WC @ _TURNED
            K[0, 2] = warp.render_size[0] - K[0, 2]
        frame = query.inspector().world_frame_id()
        camera = CroppedRender(RENDERER, warp.render_size, K, frame, RigidTransform(pose=X_WC))
        found = camera.with_labels(query)
        if plane is None:
            return found
        return LabelledPicture(
            *(part[:, ::-1] for part in (found.color, found.depth, found.labels))
        )

    def _give_back(self) -> None:
        self._last = [None, None]
        self._warps.clear()  # megabytes, which Drake would keep with this system
        remove_scene(self.__scene)
        self.__context = self.__diagram = None
        free_memory()


def _beyond(built: SelfModelPlant, joint: str) -> set[int]:
    """Return the numbers of the links that a joint moves."""
    index = built.plant.GetJointByName(joint, built.instance).index()
    return {int(body) for body in built.plant.GetBodiesKinematicallyAffectedBy([index])}


def _depth_value(width: int, height: int) -> AbstractValue:
    return AbstractValue.Make(ImageDepth32F(width, height))


def _link_value(width: int, height: int) -> AbstractValue:
    return AbstractValue.Make(ImageLabel16I(width, height))
