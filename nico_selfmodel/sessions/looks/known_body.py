"""What a robot knows of its body after it has looked at it in mirrors, unmarked."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.mirrors.body_alignment import (
    AlignedView,
    Alignment,
    BodyMotion,
    alignment_step,
)
from nico_selfmodel.estimation.mirrors.paint_colors import DESCRIBED_SIGMA, PaintColors
from nico_selfmodel.estimation.mirrors.reflection_sigma import reflection_sigma
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.mixed_steps import mixed_step
from nico_selfmodel.sessions.looks.before_pictures import before_pictures, with_cameras
from nico_selfmodel.systems.rendering.body_image import NOTHING, BodyImage
from nico_selfmodel.vision.images.body_in_room import before_room
from nico_selfmodel.vision.images.image_array import bgr_of_rgba, smoothed
from nico_selfmodel.vision.images.whose_edge import whose_edge
from nico_selfmodel.vision.surprise.surprise import away_from_the_unknown

STANDING = ("neck_yaw", "neck_pitch", "neck_roll", "eyes_tilt")
"""Joints that hold head and cameras, by the description."""
_POINT_SIGMA = 1.5e-3
"""What places may be off by while they are aligned [m]."""
_SMOOTH = 1.0
"""Of the pictures that are aligned [px]."""
AREA = 40.0
"""Pixels that err alike, as smoothing and what is not known of colours make them."""
_STEPS, _UNLIT = 24, 1
"""Of the search at most, and those before it is asked how the light stands."""
_MIXED = 4
"""Earlier steps that tell how far one falls short."""
_ARRIVED = 0.2
"""The step after which the search ends, in standard deviations of all that is known."""
_TURN, _TURN_SIGMA = 0.05, np.radians(5.0)
"""By which the light is turned to see what that changes, and how far a robot may be turned in its
room, about each axis [rad]."""


@dataclass(frozen=True, eq=False)
class Shot:
    """Both cameras' pictures of one pose before one mirror."""

    mirror: str
    """Which mirror."""
    readings: NDArray
    """Of the encoders [encoder units]. Shape (n,)."""
    pictures: tuple[NDArray, NDArray]
    """Left and right, BGR. Shape (h, w, 3) each."""


@dataclass(frozen=True, eq=False)
class KnownBody:
    """Mirrors, and how the body stands before them."""

    model: SelfModel
    """Arm, cameras, and mirrors as the body tells them."""
    mirrors: tuple[str, ...]
    """Names of these, in the order of the covariance."""
    angles: Mapping[str, float]
    """Of joints that nobody commands [rad]."""
    shift: NDArray
    """Of the whole body about its shoulder: rotation vector [rad] and translation [m], from where
    the learned arm has it. Shape (6,)."""
    p_WS: NDArray
    """The shoulder, where the learned arm has it [m]. Shape (3,)."""
    covariance: NDArray
    """Of all mirrors' values, the angles and the shift. Shape (3 m + k + 6, 3 m + k + 6)."""
    paints: PaintColors
    """What colours the body has."""
    places: Mapping[str, Mirror] = field(default_factory=dict)
    """Where the mirrors stand, with covariances that count what the cameras may be wrong by. The
    model's mirrors fit the pictures as its cameras show them, wrong as these are."""
    light: NDArray = field(default_factory=lambda: np.zeros(3))
    """How the light is turned about the robot, a rotation vector in the model's world [rad].
    Shape (3,)."""

    @property
    def X_WB(self) -> NDArray:
        """Where the whole body stands, of where the learned arm has it. Shape (4, 4)."""
        turn = rotation_from_vector(self.shift[:3])
        return transform(turn, self.p_WS + self.shift[3:] - turn @ self.p_WS)

    @property
    def values(self) -> NDArray:
        """All that the covariance is of. Shape (3 m + k + 6,)."""
        mirrors = [self.model.mirrors[name].values for name in self.mirrors]
        return np.concatenate([*mirrors, list(self.angles.values()), self.shift])

    def mirror(self, name: str) -> Mirror:
        """Return a mirror as the body tells it, without a covariance.

        Mirror and body err together: what they are off by in pictures is far less than either.
        """
        return Mirror.from_values(self.model.mirrors[name].values)

    def pose(self, image: BodyImage) -> None:
        """Let a robot's expectation of itself stand, be painted and be lit like that."""
        image.hold(self.angles, self.X_WB)
        image.turn_light(self.light)
        image.paint(self.paints.colors, self.paints.sigma)

    def motions(self, image: BodyImage) -> tuple[tuple[BodyMotion, frozenset[str]], ...]:
        """Return how the body may stand elsewhere, and the links that each of it moves."""
        joints = image.standing(tuple(self.angles))
        everything = frozenset(image.links.values())
        shoulder = self.p_WS + self.shift[3:]
        return (
            *((BodyMotion(joint.axis, joint.p_WJ), joint.links) for joint in joints),
            *((BodyMotion(axis, shoulder), everything) for axis in np.eye(3)),
            *((BodyMotion(axis, None), everything) for axis in np.eye(3)),
        )

    def changed(self, found: Alignment) -> "KnownBody":
        """Return what is known after a step of an alignment."""
        n, m = len(self.values), 3 * len(self.mirrors)
        x, covariance = self.values + found.change[:n], found.covariance[:n, :n]
        mirrors = {
            name: Mirror.from_values(
                x[3 * k : 3 * k + 3], covariance[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
            )
            for k, name in enumerate(self.mirrors)
        }
        model = replace(self.model, mirrors=MappingProxyType({**self.model.mirrors, **mirrors}))
        angles = dict(zip(self.angles, x[m:-6].tolist(), strict=True))
        return replace(
            self,
            model=model,
            angles=MappingProxyType(angles),
            shift=read_only(x[-6:]),
            covariance=read_only(covariance),
            light=read_only(self.light + found.change[n : n + 3]) if len(found.change) > n
            else self.light,
        )  # fmt: skip


def know_body(
    image: BodyImage,
    model: SelfModel,
    shots: Sequence[Shot],
    progress: Callable[[int, int], None] | None = None,
) -> KnownBody:
    """Learn where mirrors stand, and head and body before them, from the unmarked body.

    The hand in them told the mirrors (`calibrate_mirrors`), the learned arm where the body is, and
    the description how the head is held; each to so much, which is where this starts from. From the
    second step on it is asked at once with them how the room's light stands about the robot, and
    after each step which colours its paints have. Body, light and colours look much like each
    other, and edges tell little of a body that turns about itself: steps fall short by up to nine
    tenths, and are taken as far as earlier ones tell (`mixed_step`), until they are small beside
    what is known.

    Args:
        image: What the robot expects, fresh; it stands and is lit as was learned afterwards.
        shots: Of the unmarked body, of every mirror that shall be known.

    Raises:
        EstimationError: If the pictures hardly show the body.
    """
    start = _described(image, model, tuple(dict.fromkeys(shot.mirror for shot in shots)))
    known = placed = start
    by_light: Sequence[NDArray | None] = [None] * (len(SIDES) * len(shots))
    tried: list[tuple[NDArray, NDArray]] = []
    for step in range(_STEPS):
        if step == _UNLIT:
            by_light, tried = _by_light(known, image, shots), []
        known.pose(image)
        looks = [(shot, side) for shot in shots for side in range(len(SIDES))]
        ways = known.motions(image)
        views = [
            aligned_view(known, image, *look, ways, by_light=lit)
            for look, lit in zip(looks, by_light, strict=True)
        ]
        mirrors = [known.model.mirrors[name] for name in known.mirrors]
        motions = [motion for motion, _ in ways]
        before = known.values - start.values, start.covariance
        if step >= _UNLIT:
            before = np.append(before[0], known.light), _with_light(before[1])
        colors = known.paints.off, DESCRIBED_SIGMA
        found = alignment_step(views, model.rig, mirrors, motions, before, AREA, colors=colors)
        tried = [*tried, (before[0], found.change)][-_MIXED - 1 :]
        found = replace(found, change=mixed_step(tried, found.covariance))
        arrived = step > _UNLIT and found.sigmas < _ARRIVED
        if arrived or step == _STEPS - 1:
            placed = _with_cameras(known, views, mirrors, motions, before)
        known = known.changed(found)
        known = replace(known, paints=known.paints.seen_in(views, AREA))
        if progress:
            progress(_STEPS if arrived else step + 1, _STEPS)
        if arrived:
            break
    known.pose(image)
    places = {name: placed.model.mirrors[name] for name in known.mirrors}
    return replace(known, places=MappingProxyType(places))


def _with_light(own: NDArray) -> NDArray:
    """Return a covariance with that of the light's turn after it."""
    n = len(own)
    matrix = np.diag([0.0] * n + [_TURN_SIGMA**2] * 3)
    matrix[:n, :n] = own
    return matrix


def _by_light(known: KnownBody, image: BodyImage, shots: Sequence[Shot]) -> list[NDArray]:
    """Return what turned light changes of each expected picture. Shape (h, w, 3, 3) each."""
    found = []
    for turn in (np.zeros(3), *_TURN * np.eye(3)):
        replace(known, light=known.light + turn).pose(image)
        found.append([
            smoothed(bgr_of_rgba(image.expect(shot.readings, mirror, side).color), _SMOOTH)
            for shot in shots for mirror in [known.model.mirrors[shot.mirror]]
            for side in range(len(SIDES))
        ])  # fmt: skip
    plain, *turned = found
    return [
        np.stack([(one[k] - plain[k]) / np.float32(_TURN) for one in turned], axis=3)
        for k in range(len(plain))
    ]


def _with_cameras(
    known: KnownBody,
    views: Sequence[AlignedView],
    mirrors: Sequence[Mirror],
    motions: Sequence[BodyMotion],
    before: tuple[NDArray, NDArray],
) -> KnownBody:
    """Return what is known where the cameras may be wrong, too, by as much as they are known.

    Args:
        known: What was expected.
        mirrors: Of what is known, in turn.
        motions: How the body may stand elsewhere.
        before: What is known less what was before the pictures, shape (n,), and the covariance of
            that.
    """
    off, own = before
    cameras, prior = with_cameras(known.model, known.mirrors, own)
    loose = np.append(off, np.zeros(len(cameras))), prior
    colors = known.paints.off, DESCRIBED_SIGMA
    found = alignment_step(views, known.model.rig, mirrors, motions, loose, AREA, cameras, colors)
    n = len(own)
    return known.changed(Alignment(found.change[:n], found.covariance[:n, :n]))


def _described(image: BodyImage, model: SelfModel, mirrors: tuple[str, ...]) -> KnownBody:
    """Return what is known before the body was seen in a mirror."""
    joints = image.standing(STANDING)
    shoulder = image.standing(image.joints[:1])[0]
    covariance = before_pictures(model, mirrors, len(joints))
    angles = MappingProxyType({joint.name: joint.angle for joint in joints})
    paints = PaintColors.by_description(image.paints)
    return KnownBody(model, mirrors, angles, np.zeros(6), shoulder.p_WJ, covariance, paints)


def aligned_view(
    known: KnownBody,
    image: BodyImage,
    shot: Shot,
    side: int,
    motions: Sequence[tuple[BodyMotion, frozenset[str]]],
    *,
    arm: bool = False,
    smooth: float = _SMOOTH,
    by_light: NDArray | None = None,
) -> AlignedView:
    """Hold one picture beside what is expected at a shot's readings.

    Args:
        known: How the body stands, and the mirrors.
        image: What the robot expects; it stands as is known.
        shot: What it saw.
        side: The camera, 0 or 1.
        motions: How a part may stand elsewhere, and the links that each of it moves.
        arm: Whether the moving arm tells that, before the body, or the body where no arm may be.
        smooth: What both are smoothed by [px].
        by_light: What turned light changes, if that is asked for. Shape (h, w, 3, 3).
    """
    mirror = known.model.mirrors[shot.mirror]
    seen = image.expect(shot.readings, mirror, side)
    moving = np.isin(seen.labels, [*image.moving])
    depth = np.where(moving, seen.depth, np.inf) if arm else seen.depth
    sigma = reflection_sigma(known.model.rig, mirror, side, depth, _POINT_SIGMA)
    owner = whose_edge(seen.depth)
    labels = seen.labels.ravel()[owner]
    expected, picture = bgr_of_rgba(seen.color), shot.pictures[side]
    if arm:
        used = np.isfinite(sigma.ravel()[owner])
        expected = before_room(expected, picture, seen.labels != NOTHING, used)
    else:
        hidden = [NOTHING, *image.moving]
        sigma = away_from_the_unknown(np.where(np.isin(seen.labels, hidden), np.nan, sigma))
        used = np.isfinite(sigma)
    numbers = {name: number for number, name in image.links.items()}
    moved = [np.isin(labels, [numbers[link] for link in links]) for _, links in motions]
    return AlignedView(
        side,
        known.mirrors.index(shot.mirror),
        smoothed(picture, smooth),
        smoothed(expected, smooth),
        seen.depth.ravel()[owner],
        used,
        np.array(moved),
        by_light,
        seen.paints,
    )
