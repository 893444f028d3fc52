"""The outer shape of links that an arm moves, from a recording that kept its pictures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.noise.hand_observations import covariance_of
from nico_selfmodel.estimation.noise.joints_by_hand import JointsByHand
from nico_selfmodel.estimation.observations.matching import reading_columns
from nico_selfmodel.estimation.shape.fusion import DepthView, first_surface
from nico_selfmodel.estimation.shape.refinement import MOVING_STEPS, RefinedSurface
from nico_selfmodel.estimation.shape.shape_views import ShapeView, ShapeViews
from nico_selfmodel.estimation.shape.standpoints import OnLink
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.shape.link_shape import BodyShape
from nico_selfmodel.plant.kinematic_tree import KinematicTree
from nico_selfmodel.sessions.looks.before_pictures import loose_cameras
from nico_selfmodel.sessions.looks.card import Card, card_of
from nico_selfmodel.sessions.mirrors.learned_shape import links_of, refined
from nico_selfmodel.sessions.mirrors.own_pictures import described
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.sessions.shapes.arm_looks import FEWEST_LOOKS, ArmLook, ArmLooks
from nico_selfmodel.sessions.shapes.rigid_body import RigidBody
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.images.body_outline import beyond_body, plain_color
from nico_selfmodel.vision.images.stereo_depth import RectifiedPair

_NEAREST = 0.12
"""What is nearer to the cameras is not looked for [m]."""
_COARSE = 0.5
"""Of a picture's width and height, in which depths are matched: outlines and the refinement are
finer, and a whole picture of what is so near takes seconds."""
_INSIDE = -1.0
"""Depths count so far inside of the outline [px]."""
_ROOM, _ALIKE = 0.3, 8.0
"""Least share of a picture that a plain room covers, and by how much its colour varies there."""
_ABOUT = 10
"""Pixels of a picture about what may be a body, by which it is blurred [px]."""
_LEAST = 400
"""Pixels of a body without which a picture does not count."""
_GATE_6 = 22.458
"""What a chi-square of six degrees of freedom exceeds once in a thousand times."""
TURN, SHIFT = 5e-4, 1e-4
"""By which a learned arm is wrong beyond its joints' noise, otherwise in each pose [rad, m]: with
these chi-square of a forearm's poses is 0.9 and 1.5 a degree of freedom (robots 1893, 1912)."""


@dataclass(frozen=True, eq=False)
class MovingShape:
    """What pictures of an arm told of its links."""

    body: BodyShape
    """Of each link, and where it stood in the first look."""
    errors: JointsByHand
    """Of the joints in all poses."""
    poses: Mapping[str, NDArray]
    """Link -> where it was in each look, as the arm and the hand in it tell. Shape (K, 4, 4)."""

    @property
    def looks(self) -> int:
        """Poses in which the arm was looked at."""
        return int(self.errors.expected.sum())


def shape_of_arm(
    model: SelfModel,
    data: Dataset,
    folder: str | Path,
    links: Sequence[str],
    rng: np.random.Generator,
    stage: Stage | None = None,
) -> MovingShape:
    """Learn the outer shape of links that move, from pictures of the arm itself.

    A camera that stands still before a link that moves is a camera that moves before a link that
    stands still: where it is in the link's frame the learned arm tells, whose joints are corrected
    by where the hand was seen, and in the end the pictures.

    Args:
        model: Arm and cameras, and the robot's description.
        data: Poses without a mirror.
        folder: In which it lies, with its pictures.
        links: Whose shape is learned; all move with the arm (`rigid_body.all_move`).
        rng: Source of samples of what is not known.
        stage: Told how far it is.

    Raises:
        ModelError: If the model lacks cameras, an arm or a description.
        DataError: If pictures are missing or of another size, or the hand is never seen.
        EstimationError: If too few poses show a link, the room is not plain, or no surface is
            found.
    """
    robot = described(model)
    looks = ArmLooks.of(model, data, folder)
    _require_enough(len(looks.kept), "")
    tell = telling(stage, "looking at the arm")
    with BodyImage(robot, model, supersample=1) as image:  # labels alone are asked for
        tree = KinematicTree.from_urdf(robot.urdf)
        pair = RectifiedPair.of(model.rig, _COARSE)
        readings = looks.data.encoders[0][reading_columns(model, looks.data)]
        first = image.poses(readings)
        bodies = [
            _Seen(one, model, _card_on(one, tree, model, readings, first))
            for one in RigidBody.of(tree, model.joints, links, first)
        ]
        noise, stood = looks.noise, []
        for k, look in enumerate(looks.looks(image)):
            stood.append(look.poses)
            told = _ToldApart(look, noise, pair)
            for body in bodies:
                body.take(told, image)
            tell(k + 1, len(looks.kept))
    shapes, poses = {}, stood[0]
    for body in bodies:
        surface = body.learned(rng, stage)
        own = {link: inverse(poses[body.rigid.frame]) @ poses[link] for link in body.rigid.wanted}
        shapes |= links_of(surface, body.rigid.skeleton, own, body.rigid.wanted)
    shapes = {link: shapes[link] for link in links}
    X_WF = {link: poses[link] for link in links}
    each = {link: np.array([one[link] for one in stood]) for link in links}
    return MovingShape(BodyShape(shapes, X_WF), looks.errors, each)


@dataclass(frozen=True, eq=False)
class _ToldApart:
    """What of a look's pictures is the room, and how far away the arm is: once for all bodies."""

    look: ArmLook
    noise: tuple[float, float]
    pair: RectifiedPair

    @cached_property
    def beyond(self) -> list[NDArray] | None:
        """How far pixels are outside of what stands before the room. Shape (h, w) each [px].

        None where a picture shows nothing but the room: the arm is too far aside.

        Raises:
            EstimationError: If the room is not plain.
        """
        both = zip(self.look.pictures, self.noise, strict=True)
        seen = [(picture, room_color(picture), noise) for picture, noise in both]
        try:
            return [beyond_body(*one) for one in seen]
        except EstimationError:
            return None

    @cached_property
    def depth(self) -> NDArray:
        """What the left turned camera sees of depths. Shape (h, w) [m]."""
        return self.pair.depth(self.look.pictures, _NEAREST).astype(np.float32)


@dataclass(frozen=True, eq=False)
class _Seen:
    """A body in all looks that show it; the lists grow look by look."""

    rigid: RigidBody
    model: SelfModel
    card: Card | None
    standpoints: list[OnLink] = field(default_factory=list)
    covariances: list[NDArray] = field(default_factory=list)
    views: list[ShapeView] = field(default_factory=list)
    depths: list[DepthView] = field(default_factory=list)

    def take(self, told: _ToldApart, image: BodyImage) -> None:
        """Take what a look shows of the body, if it shows enough."""
        rigid, look, k = self.rigid, told.look, len(self.standpoints)
        own = [number for number, name in image.links.items() if name in rigid.links]
        if min(int(np.isin(labels, own).sum()) for labels in look.labels) < _LEAST:
            return
        if told.beyond is None:
            return
        rig, X_WF, J = self.model.rig, look.poses[rigid.frame], look.by_joint[rigid.frame]
        beyond = [
            np.where(look.covered(image, rigid.links, side), np.nan, outside)
            for side, outside in enumerate(told.beyond)
        ]
        pixels = rig.project(apply(X_WF, rigid.places))
        self.views.extend(
            _cropped(ShapeView(k, side, picture, beyond[side]), pixels[:, 2 * side : 2 * side + 2])
            for side, picture in enumerate(look.pictures)
        )
        inside = told.pair.bent(beyond[0], 0) < _INSIDE
        depth = np.where(inside, told.depth, np.float32(np.nan))
        self.depths.append(DepthView(k, told.pair.turned[0], depth))
        self.standpoints.append(OnLink(X_WF, np.zeros(6)))
        self.covariances.append(of_pose(J, look.covariance))

    def learned(self, rng: np.random.Generator, stage: Stage | None) -> RefinedSurface:
        """Return the surface that these looks show."""
        _require_enough(len(self.standpoints), f" {' and '.join(self.rigid.wanted)}")
        grid = self.rigid.grid
        views = self._together(grid.points.mean(axis=0))
        mesh = first_surface(grid, self.rigid.near(grid.points), views, self.depths)
        self.depths.clear()
        tell, jumps = telling(stage, "learning its shape"), self.card and self.card.at_rim
        return refined(views, mesh, rng, tell, MOVING_STEPS, _GATE_6, jumps)

    def _together(self, p_FQ: NDArray) -> ShapeViews:
        """Return all pictures, and by how many pixels each is loose about a point of the body."""
        cameras = loose_cameras(self.model)
        count = 6 * len(self.standpoints)
        covariance = np.zeros((count + len(cameras),) * 2)
        for k, own in enumerate(self.covariances):
            covariance[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = own
        covariance[count:, count:] = covariance_of(self.model, cameras)
        views = ShapeViews(
            tuple(self.views), self.model.rig, tuple(self.standpoints), cameras, covariance
        )
        loose = []
        for view, (_, by_value) in zip(views.views, views.slopes(p_FQ[None]), strict=True):
            J = by_value[0, :, :6]
            variance = np.trace(J @ self.covariances[view.look] @ J.T) / 2.0
            loose.append(replace(view, loose=float(np.sqrt(variance))))
        return replace(views, views=tuple(loose))


def of_pose(by_joint: NDArray, joints: NDArray) -> NDArray:
    """Return what the pose of a link is known to by an arm that is. Shape (6, 6).

    Args:
        by_joint: How it is turned and shifted by the joints [1, m/rad]. Shape (6, n).
        joints: Their covariance in this look [rad^2]. Shape (n, n).
    """
    other = np.diag(np.square([TURN] * 3 + [SHIFT] * 3))
    return by_joint @ joints @ by_joint.T + other


def _card_on(
    rigid: RigidBody,
    tree: KinematicTree,
    model: SelfModel,
    readings: NDArray,
    poses: Mapping[str, NDArray],
) -> Card | None:
    """Return the card of the hand's marker, of the body that the last joint moves."""
    above = [tree.joint_above[link].name() for link in rigid.links if link in tree.joint_above]
    return card_of(model, readings, poses[rigid.frame]) if model.joints[-1] in above else None


def room_color(picture: NDArray) -> NDArray:
    """Return the colour of a plain room, which most of a picture shows.

    Raises:
        EstimationError: If it is not plain.
    """
    color = plain_color(picture)
    share = float(np.mean(np.abs(picture - color).max(axis=2) < _ALIKE))
    if share < _ROOM:
        raise EstimationError(
            f"{100.0 * share:.0f} % of a picture has one colour: what is before the room is told "
            "by the room's colour, which must be plain"
        )
    return color


def _cropped(view: ShapeView, pixels: NDArray) -> ShapeView:
    """Return the part of a picture in which some places are, nan of those out of view. (N, 2)."""
    height, width = view.beyond.shape
    seen = pixels[np.isfinite(pixels).all(axis=1)]
    left, top = np.clip(seen.min(axis=0).astype(int) - _ABOUT, 0, [width - 8, height - 8])
    right, low = np.clip(seen.max(axis=0).astype(int) + _ABOUT, 8, [width, height])
    part = np.s_[top:low, left:right]
    picture, beyond = view.picture[part].copy(), view.beyond[part].copy()  # not the whole of both
    return replace(view, picture=picture, beyond=beyond, corner=(int(left), int(top)))


def _require_enough(count: int, what: str) -> None:
    """Raise an EstimationError if looks are too few for a shape."""
    if count < FEWEST_LOOKS:
        raise EstimationError(
            f"{count} poses show{what or ' the hand'} where it is expected, a shape takes "
            f"{FEWEST_LOOKS}: record more with `record --images --random`"
        )
