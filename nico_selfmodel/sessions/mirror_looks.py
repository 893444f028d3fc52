"""Looking into a mirror at oneself, and what of it was not expected."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.reflection_sigma import reflection_sigma
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.rendering.body_image import NOTHING, BodyImage
from nico_selfmodel.systems.rendering.mirror_scene import put_mirror
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.vision.images.image_array import bgr_of_rgba
from nico_selfmodel.vision.images.motion_mask import picture_noise
from nico_selfmodel.vision.surprise.blobs import Blob, surprising_places
from nico_selfmodel.vision.surprise.surprise import (
    Expectation,
    Surprise,
    away_from_the_unknown,
    surprise,
)

POINT_SIGMA = 3e-3
"""What places of links that were not learned are not known by: the head's joints are held to a
degree, and its face is 0.15 m from them [m]."""
APPEARANCE_SIGMA = 0.03
"""What colours and light of the description are not known by, as a share of the grey level; set on
robot 0."""


@dataclass(frozen=True, eq=False)
class MirrorLook:
    """One camera's look at oneself in a mirror."""

    side: str
    """Which camera."""
    picture: NDArray
    """What it saw, BGR. Shape (h, w, 3)."""
    expected: Expectation
    """What it should have seen, and where that was judged."""
    surprise: Surprise
    """What differs."""
    blobs: tuple[Blob, ...]
    """Where it differs more than it should."""


class MirrorLooks:
    """A robot before a mirror that it knows, comparing what it sees with what it expects."""

    def __init__(
        self,
        station: NicoStation,
        image: BodyImage,
        model: SelfModel,
        mirror: Mirror,
        X_BM: NDArray,
    ) -> None:
        """Put the mirror before the robot, and see how noisy its pictures are.

        Args:
            station: Open, with a mirror; it is not closed here.
            image: What the robot expects; it is not closed here.
            model: What it has learned of arm and cameras.
            mirror: As it has learned it.
            X_BM: Where the glass really stands, in the frame of the arm's base. Shape (4, 4).
        """
        self._station, self._image, self._rig, self._mirror = station, image, model.rig, mirror
        self._body = StationBody(station, station.joints, station.tracked)
        put_mirror(station, self._body.context, X_BM)
        before = self._pictures()
        self._body.relive(self._readings())
        self.noise = tuple(map(picture_noise, before, self._pictures()))
        """Standard deviation of a grey level, of each camera."""

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
        self._body.relive(command)
        readings = self._readings()
        left, right = (
            self._judged(side, picture, readings) for side, picture in enumerate(self._pictures())
        )
        return left, right

    def _judged(self, side: int, picture: NDArray, readings: NDArray) -> MirrorLook:
        seen = self._image.expect(readings, self._mirror, side)
        sigma = reflection_sigma(self._rig, self._mirror, side, seen.depth, POINT_SIGMA)
        hidden = np.isin(seen.labels, [NOTHING, *self._image.moving])
        sigma = away_from_the_unknown(np.where(hidden, np.nan, sigma))
        expected = Expectation(bgr_of_rgba(seen.color), sigma, self.noise[side], APPEARANCE_SIGMA)
        found = surprise(picture, expected)
        return MirrorLook(SIDES[side], picture, expected, found, surprising_places(found))

    def _pictures(self) -> list[NDArray]:
        return [self._station.picture(self._body.context, side) for side in SIDES]

    def _readings(self) -> NDArray:
        port = self._station.GetOutputPort("encoders")
        return np.array(port.Eval(self._body.context), dtype=float)
