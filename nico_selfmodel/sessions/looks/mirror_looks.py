"""Looking into a mirror at oneself, and what of it was not expected."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.looks.expecting import (
    Expecting,
    MirrorLook,
    Unknown,
    unlike_share,
)
from nico_selfmodel.sessions.looks.known_body import KnownBody, Shot
from nico_selfmodel.sessions.looks.least_unknown import COLOR_SIGMA, POINTS, Told, least_unknown
from nico_selfmodel.sessions.looks.seen_arm import SeenArm, see_arm
from nico_selfmodel.systems.closing import trim_memory
from nico_selfmodel.systems.rendering.body_image import BodyImage, ExpectedPicture
from nico_selfmodel.systems.rendering.mirror_scene import put_mirror
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.vision.images.motion_mask import picture_noise
from nico_selfmodel.vision.surprise.blobs import FALSE_ALARM, threshold_of
from nico_selfmodel.vision.surprise.seen_places import WEAK
from nico_selfmodel.vision.surprise.surprise import (
    Surprise,
    as_before,
    log_likelihood,
    surprise,
)

PAINT = 2e-4
"""How thick paint may be that moves an outline it lies on [m]."""
_ELSEWHERE = 0.05
"""Share of an arm that looks otherwise than expected where it stands elsewhere than it was seen."""


@dataclass(frozen=True, eq=False)
class _Seen:
    """One camera's look at an unmarked body."""

    side: int
    picture: NDArray
    expected: ExpectedPicture
    arm: SeenArm | None


class MirrorLooks:
    """A robot before a mirror that it knows, comparing what it sees with what it expects."""

    def __init__(
        self,
        station: NicoStation,
        image: BodyImage,
        model: SelfModel,
        mirror: Mirror,
        X_BM: NDArray,
        *,
        unknown: Unknown | None = None,
    ) -> None:
        """Put the mirror before the robot, and see how noisy its pictures are.

        Args:
            station: Open, with a mirror; it is not closed here.
            image: What the robot expects; it is not closed here.
            model: What it has learned of arm and cameras.
            X_BM: Where the glass really stands, in the frame of the arm's base. Shape (4, 4).
            unknown: What body and colours are not known by; what the description is if omitted.
        """
        self._station, self._image, self._rig, self._mirror = station, image, model.rig, mirror
        self.unknown = unknown or Unknown()
        """What body and colours are not known by."""
        self._known: tuple[KnownBody, str] | None = None
        self.body = StationBody(station, station.joints, station.tracked)
        """What moves the robot."""
        put_mirror(station, self.body.context, X_BM)
        before = self._pictures()
        self.body.relive(self._readings())
        left, right = map(picture_noise, before, self._pictures())
        self.noise = left, right
        """Standard deviation of a grey level, of each camera."""

    def before(self, mirror: Mirror, X_BM: NDArray) -> None:
        """Have another mirror before the robot.

        Args:
            X_BM: Where the glass really stands, in the frame of the arm's base. Shape (4, 4).
        """
        self._mirror, self._known = mirror, None
        put_mirror(self._station, self.body.context, X_BM)

    def before_known(self, name: str, known: KnownBody, unknown: Unknown, X_BM: NDArray) -> None:
        """Have a mirror before the robot in which it knows how it stands: it sees its arm, too.

        Args:
            name: Which mirror.
            known: How the body stands before it, as the image does.
            unknown: What body and colours are not known by in it.
            X_BM: Where the glass really stands, in the frame of the arm's base. Shape (4, 4).
        """
        self.before(known.mirror(name), X_BM)
        self.unknown, self._known = unknown, (known, name)

    def room(self) -> NDArray:
        """Put the mirror away and return what the left camera sees, BGR. Shape (h, w, 3)."""
        put_mirror(self._station, self.body.context, None)
        return self._pictures()[0]

    def shot(self, name: str, command: NDArray) -> Shot:
        """Go to a pose and take a picture with each camera.

        Args:
            command: Where to go [encoder units]. Shape (n,).
        """
        self.body.relive(command)
        left, right = self._pictures()
        return Shot(name, self._readings(), (left, right))

    def look(self, command: NDArray) -> tuple[MirrorLook, MirrorLook]:
        """Go to a pose and look.

        The moving arm is judged as it is seen to stand (`see_arm`), before a mirror in which it is
        known how the body stands. Before others it is not, nor what it covers: its joints are loose
        by more than its outline may be off.

        Args:
            command: Where to go [encoder units]. Shape (n,).

        Returns:
            What the left and the right camera saw.

        Raises:
            ValueError: If nothing of the body is in view.
        """
        self.body.relive(command)
        return self.judge()

    def judge(self) -> tuple[MirrorLook, MirrorLook]:
        """Look from where the robot stands; returns and raises as `look`."""
        readings, pictures = self._readings(), self._pictures()
        arm = self._arm(readings, pictures)
        pair = self._judged(readings, pictures, arm)
        if arm is not None and unlike_share(pair, self._image.moving) > _ELSEWHERE:
            return self._judged(readings, pictures, None)
        return pair

    def _judged(
        self, readings: NDArray, pictures: Sequence[NDArray], arm: SeenArm | None
    ) -> tuple[MirrorLook, MirrorLook]:
        """Hold pictures of one look against what is expected, with an arm that was seen or not."""
        expecting = self._expecting()
        left, right = (
            expecting.judged(side, picture, readings, arm) for side, picture in enumerate(pictures)
        )
        return left, right

    def _arm(self, readings: NDArray, pictures: Sequence[NDArray]) -> SeenArm | None:
        """Return how the arm stands in pictures of one look, if that can be told."""
        if self._known is None:
            return None
        known, name = self._known
        return see_arm(self._image, known, Shot(name, readings, (pictures[0], pictures[1])))

    def judged_at(self, readings: NDArray) -> tuple[NDArray, NDArray]:
        """Return which pixels of left and right picture would be judged, without a look.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).

        Returns:
            Truth values. Shape (h, w) each.
        """
        left, right = (
            np.isfinite(self._expecting().pixel_sigma(side, seen))
            for side in range(len(SIDES))
            for seen in [self._image.expect(readings, self._mirror, side)]
        )
        return left, right

    def covered_at(self, readings: NDArray) -> tuple[NDArray, NDArray]:
        """Return which pixels of left and right picture the moving arm may cover.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).

        Returns:
            Truth values. Shape (h, w) each.
        """
        expecting = self._expecting()
        left, right = (
            expecting.covered(side, self._image.expect(readings, self._mirror, side))
            for side in range(len(SIDES))
        )
        return left, right

    def clearance(self, readings: NDArray) -> float:
        """Return how far the nearest link of the arm would be from the glass, negative beyond [m].

        Links count by the origins of their frames.

        Args:
            readings: Of the encoders [encoder units]. Shape (n,).
        """
        poses, names = self._image.poses(readings), self._image.links
        ends = np.array([poses[names[number]][:3, 3] for number in self._image.moving])
        plane = self._mirror.plane_in(self._rig.left.X_WC)
        return float(plane.distance_to(ends).min())

    def changes(self, shot: Shot, pair: tuple[MirrorLook, MirrorLook]) -> tuple[Surprise, Surprise]:
        """Return what has changed since a shot, where nothing is judged by the expected body.

        What is not oneself is expected to look as it did, and so are one's own outline and arm,
        which stand still, but for the thickness of paint: where it is of the same colour as what is
        under it, it only moves an outline.

        Args:
            shot: Taken before, from where the robot stands now.
            pair: What it sees now.

        Raises:
            ValueError: If all of a picture is judged by the expected body.
        """
        left, right = (
            surprise(
                look.picture,
                as_before(
                    picture,
                    look.surprise,
                    look.expected.noise,
                    COLOR_SIGMA,
                    camera.fx * PAINT / float(np.median(look.depth[np.isfinite(look.depth)])),
                ),
            )
            for picture, look, camera in zip(shot.pictures, pair, self._rig.cameras, strict=True)
        )
        return left, right

    def _expecting(self, unknown: Unknown | None = None) -> Expecting:
        known = unknown or self.unknown
        return Expecting(self._image, self._rig, self._mirror, self.noise, known)

    def unknown_of(self, commands: Sequence[NDArray]) -> Unknown:
        """Learn from the unmarked body how far each of its links looks otherwise than expected.

        See `least_unknown`.

        Args:
            commands: Where to go [encoder units]. Shape (n,) each.

        Returns:
            What is not known, which counts from now on.
        """
        looks = [look for command in commands for look in self._seen_at(command)]
        self.unknown = least_unknown(lambda color: self._told(looks, color))
        return self.unknown

    def _seen_at(self, command: NDArray) -> list[_Seen]:
        """Go to a pose, and return what each side saw, and what is expected there."""
        self.body.relive(command)
        readings, pictures = self._readings(), self._pictures()
        arm = self._arm(readings, pictures)
        readings = readings if arm is None else arm.readings
        return [
            _Seen(side, picture, self._image.expect(readings, self._mirror, side), arm)
            for side, picture in enumerate(pictures)
        ]

    def _told(self, looks: Sequence[_Seen], color: float) -> Told:
        """Return what looks tell of each of `POINTS`, with colours known to a share."""
        shape = len(POINTS), max(self._image.links) + 1
        likely, counts, places = np.zeros(shape), np.zeros(shape), np.zeros((3, *shape))
        strange = np.full((len(POINTS), len(SIDES), *looks[0].expected.labels.shape), -1, np.int16)
        for look in looks:
            labels = look.expected.labels
            for k, point in enumerate(POINTS):
                unknown = Unknown({}, point, color)
                expected = self._expecting(unknown).expected(look.side, look.expected, look.arm)
                each = log_likelihood(look.picture, expected)
                own = labels[np.isfinite(each)]
                likely[k] += np.bincount(own, each[np.isfinite(each)], shape[1])
                counts[k] += np.bincount(own, minlength=shape[1])
                chi_square = surprise(look.picture, expected).chi_square
                judged, filled = np.isfinite(chi_square), np.nan_to_num(chi_square)
                above, alarms = (
                    filled > threshold_of(int(judged.sum()), rate) for rate in (WEAK, FALSE_ALARM)
                )
                for found, which in zip(places, (above, judged, alarms), strict=True):
                    found[k] += np.bincount(labels[which], minlength=shape[1])
                standing = above & ~np.isin(labels, [*self._image.moving])
                strange[k, look.side][standing] = labels[standing]
        links = {name: k for k, name in self._image.links.items() if counts[0, k]}
        share = places[0] / np.maximum(places[1], 1.0)
        moving = frozenset(self._image.links[number] for number in self._image.moving)
        each = np.where(counts > 0.0, likely / np.maximum(counts, 1.0), -np.inf)
        return Told(each, share, strange, links, places[2], moving)

    def unlike(self, commands: Sequence[NDArray], links: Collection[str]) -> float:
        """Return which share of some links of the unmarked body does not look as expected.

        Where all sigmas are right it is one place in a thousand, and edges err together; where the
        mirror is not what it is taken for, it is a good part of what it shows.

        Args:
            commands: Where to go [encoder units]. Shape (n,) each.
            links: What counts.

        Returns:
            The largest of all pictures; 1 where none of the links is in one.
        """
        numbers = [number for number, name in self._image.links.items() if name in links]
        shares = [look.unlike(numbers) for command in commands for look in self.look(command)]
        return max(shares)

    def _pictures(self) -> list[NDArray]:
        found = [self._station.picture(self.body.context, side) for side in SIDES]
        trim_memory()  # else what is rendered next comes on top of what these took
        return found

    def _readings(self) -> NDArray:
        port = self._station.GetOutputPort("encoders")
        return np.array(port.Eval(self.body.context), dtype=float)
