"""Looking into a mirror at oneself, and what of it was not expected."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.mirrors.expecting import (
    MOST_UNLIKE,
    POINT_SIGMA,
    Expecting,
    MirrorLook,
    Unknown,
)
from nico_selfmodel.sessions.mirrors.known_body import Shot
from nico_selfmodel.systems.closing import trim_memory
from nico_selfmodel.systems.rendering.body_image import BodyImage, ExpectedPicture
from nico_selfmodel.systems.rendering.mirror_scene import put_mirror
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.vision.images.motion_mask import picture_noise
from nico_selfmodel.vision.surprise.blobs import threshold_of
from nico_selfmodel.vision.surprise.seen_places import WEAK
from nico_selfmodel.vision.surprise.surprise import (
    Surprise,
    about_the_loose,
    as_before,
    log_likelihood,
    surprise,
)

COLOR_SIGMA = 0.01
"""What colours are not known by once the body has been looked at, as a share of the grey level; set
on robots 0 and 1."""
PAINT = 2e-4
"""How thick paint may be that moves an outline it lies on [m]."""
COLORS = (COLOR_SIGMA, 0.02, 0.04, 0.08)
"""What colours and light of a link may turn out not to be known by, as a share."""
POINTS = (2.5e-4, 3.5e-4, 5e-4, 7e-4, 1e-3, 1.4e-3, 2e-3, POINT_SIGMA)
"""What places of a link may turn out not to be known by [m]."""
_STRANGE_SIGMA = 0.8
"""Of where what is strange is seen, so that nothing within 3 px of it is judged [px]."""


@dataclass(frozen=True, eq=False)
class Told:
    """What looks at the unmarked body tell of each of `POINTS`, at one share of `COLORS`."""

    likely: NDArray
    """Mean log likelihood of the pixels of each link. Shape (P, L)."""
    share: NDArray
    """Of its places those that are even weakly surprising. Shape (P, L)."""
    strange: NDArray
    """Number of the link that is so in each pixel of left and right picture, -1 where none is.
    Shape (P, 2, h, w)."""
    links: Mapping[str, int]
    """Those that are judged, and which of L they are."""


def least_unknown(told: Callable[[float], Told]) -> Unknown:
    """Return how far each link looks otherwise than expected.

    Of several sigmas of its place those count that leave next to nothing of the link even weakly
    surprising, for what is wrong there is wrong in every look, and noise adds to it; of them the
    likeliest. What is left is strange: a crack that is seen into, which tells of itself and not of
    the link. Where no sigma does its colours are known less, by as little as leaves one: the light
    stands in the room, and is taken to stand with the robot, which may be turned there by some
    degrees. Where that leaves none the largest counts of its place.

    Args:
        told: What looks tell where colours are known to a share; asked for more as needed.
    """
    points: dict[str, float] = {}
    colors: dict[str, float] = {}
    likeliest: dict[str, float] = {}
    strange: list[NDArray] = []
    for color in COLORS:
        found = told(color)
        calm = np.where(found.share > MOST_UNLIKE, -np.inf, found.likely)
        for name, k in found.links.items():
            likeliest.setdefault(name, POINTS[int(np.argmax(found.likely[:, k]))])
            if name not in points and np.isfinite(calm[:, k]).any():
                best = int(np.argmax(calm[:, k]))
                points[name], colors[name] = POINTS[best], color
                strange.append(found.strange[best] == k)
        if found.links.keys() <= points.keys():
            break
    less = {name: color for name, color in colors.items() if color > COLOR_SIGMA}
    about = None if not strange else _about(np.any(strange, axis=0))
    return Unknown(points, POINT_SIGMA, likeliest, COLOR_SIGMA, less, about)


def _about(strange: NDArray) -> tuple[NDArray, NDArray]:
    """Return what lies about strange places of left and right picture. Shape (h, w) each."""
    left, right = (about_the_loose(np.where(one, _STRANGE_SIGMA, np.nan)) for one in strange)
    return left, right


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
        self._mirror = mirror
        put_mirror(self._station, self.body.context, X_BM)

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

        The moving arm is not judged, nor what it covers: its joints are loose by more than its
        outline may be off.

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
        readings, expecting = self._readings(), self._expecting()
        left, right = (
            expecting.judged(side, picture, readings)
            for side, picture in enumerate(self._pictures())
        )
        return left, right

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

    def _seen_at(self, command: NDArray) -> list[tuple[int, NDArray, ExpectedPicture]]:
        """Go to a pose, and return each side with what it saw and what is expected there."""
        self.body.relive(command)
        readings = self._readings()
        return [
            (side, picture, self._image.expect(readings, self._mirror, side))
            for side, picture in enumerate(self._pictures())
        ]

    def _told(self, looks: Sequence[tuple[int, NDArray, ExpectedPicture]], color: float) -> Told:
        """Return what looks tell of each of `POINTS`, with colours known to a share."""
        shape = len(POINTS), max(self._image.links) + 1
        likely, counts, places = np.zeros(shape), np.zeros(shape), np.zeros((2, *shape))
        strange = np.full((len(POINTS), len(SIDES), *looks[0][2].labels.shape), -1, np.int16)
        for side, picture, seen in looks:
            for k, point in enumerate(POINTS):
                unknown = Unknown({}, point, {}, color)
                expected = self._expecting(unknown).expected(side, seen)
                each = log_likelihood(picture, expected)
                own = seen.labels[np.isfinite(each)]
                likely[k] += np.bincount(own, each[np.isfinite(each)], shape[1])
                counts[k] += np.bincount(own, minlength=shape[1])
                chi_square = surprise(picture, expected).chi_square
                judged = np.isfinite(chi_square)
                above = np.nan_to_num(chi_square) > threshold_of(int(judged.sum()), WEAK)
                for found, which in zip(places, (above, judged), strict=True):
                    found[k] += np.bincount(seen.labels[which], minlength=shape[1])
                strange[k, side][above] = seen.labels[above]
        links = {name: k for k, name in self._image.links.items() if counts[0, k]}
        share = places[0] / np.maximum(places[1], 1.0)
        return Told(likely / np.maximum(counts, 1.0), share, strange, links)

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
