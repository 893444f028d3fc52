"""What a robot expects to see of itself in a mirror, and how a picture differs from it."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.reflection_sigma import reflection_sigma
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.rendering.body_image import NOTHING, BodyImage, ExpectedPicture
from nico_selfmodel.systems.rendering.cropped_render import LabelledPicture
from nico_selfmodel.vision.images.image_array import bgr_of_rgba
from nico_selfmodel.vision.surprise.blobs import Blob, surprising_places
from nico_selfmodel.vision.surprise.surprise import (
    Expectation,
    Surprise,
    about_the_loose,
    away_from_the_unknown,
    surprise,
)

POINT_SIGMA = 3e-3
"""What places of links that were not learned are not known by: the head's joints are held to a
degree, and its face is 0.15 m from them [m]."""
APPEARANCE_SIGMA = 0.03
"""What colours and light of the description are not known by, as a share of the grey level; set on
robot 0."""
MOST_UNLIKE = 0.01
"""Share of the unmarked head and chest that a mirror may show otherwise than expected."""
_UNLIKE = 16.27
"""Chi-square of three degrees of freedom that one place in a thousand exceeds by chance."""
_WHOLE = 0.2
"""Of what a link's places are likeliest not known by, what is the place of the whole link: the rest
is another in each edge. Once body and light are known at once it is off by 0.05 mm (robots 1833 and
1846) of 0.25 (1846)."""


@dataclass(frozen=True, eq=False)
class Unknown:
    """What a body may look otherwise by than expected: standard deviations."""

    points: Mapping[str, float] = field(default_factory=dict)
    """Link -> of its places, each coordinate [m]."""
    other: float = POINT_SIGMA
    """The same of all other links [m]."""
    likely: Mapping[str, float] = field(default_factory=dict)
    """Link -> what of its places, each coordinate, is likeliest not known [m]."""
    color: float = APPEARANCE_SIGMA
    """Of colours and light, as a share of the grey level."""
    colors: Mapping[str, float] = field(default_factory=dict)
    """Link -> the same of one that is less well known: how the robot is turned to the light, which
    stands in the room, counts for one more than for another."""
    strange: tuple[NDArray, NDArray] | None = None
    """Pixels of left and right picture about what looks otherwise than expected in a mirror though
    nothing is on it, of which the expected body tells nothing. Shape (h, w) each."""

    def __post_init__(self) -> None:
        """Make the mappings read-only."""
        for name in ("points", "likely", "colors"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def place_sigma(self, link: str) -> float:
        """Return what the place of a whole link is not known by, each coordinate [m]."""
        return _WHOLE * self.likely.get(link, self.points.get(link, self.other))


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
    labels: NDArray
    """Link that is expected in each pixel, by its number in `BodyImage.links`. Shape (h, w)."""
    readings: NDArray
    """Of the encoders [encoder units]. Shape (n,)."""
    depth: NDArray
    """Along the optical axis to where what is expected seems to be; inf where that is nothing [m].
    Shape (h, w)."""

    def unlike(self, numbers: Collection[int]) -> float:
        """Return which share of some links does not look as expected; 1 where none is in view.

        Where all sigmas are right it is one place in a thousand, and edges err together.
        """
        chi_square = self.surprise.chi_square
        own = np.isfinite(chi_square) & np.isin(self.labels, [*numbers])
        return float(np.mean(chi_square[own] > _UNLIKE)) if own.any() else 1.0


@dataclass(frozen=True, eq=False)
class Expecting:
    """A robot before a mirror, and how well it knows what it expects there."""

    image: BodyImage
    """What it expects; it is not closed here."""
    rig: StereoRig
    """Its cameras."""
    mirror: Mirror
    """What it looks into."""
    noise: tuple[float, float]
    """Standard deviation of a grey level, of each camera."""
    unknown: Unknown
    """What body and colours are not known by."""

    def judged(self, side: int, picture: NDArray, readings: NDArray) -> MirrorLook:
        """Hold what one camera saw against what is expected.

        Args:
            side: Which camera, 0 or 1.
            picture: What it saw, BGR. Shape (h, w, 3).
            readings: Of the encoders [encoder units]. Shape (n,).

        Raises:
            ValueError: If nothing of the body is in view.
        """
        seen = self.image.expect(readings, self.mirror, side)
        expected = self.expected(side, seen)
        found = surprise(picture, expected)
        places = surprising_places(found)
        return MirrorLook(
            SIDES[side], picture, expected, found, places, seen.labels, readings, seen.depth
        )

    def expected(self, side: int, seen: ExpectedPicture) -> Expectation:
        """Return an expected picture, what is judged of it, and how well it is known."""
        sigma = self.pixel_sigma(side, seen)
        share = self._by_link(seen, self.unknown.colors, self.unknown.color)
        paint_sigma = np.append(self.image.paint_sigma, 0.0)  # number -1 is no paint
        share = np.hypot(share, paint_sigma[seen.paints])
        return Expectation(bgr_of_rgba(seen.color), sigma, self.noise[side], share)

    def _by_link(self, seen: LabelledPicture, known: Mapping[str, float], other: float) -> NDArray:
        """Return what is known of each link at each pixel that shows it. Shape (h, w)."""
        each = np.full(seen.labels.shape, other)
        for number, name in self.image.links.items():
            if name in known:
                each[seen.labels == number] = known[name]
        return each

    def pixel_sigma(self, side: int, seen: LabelledPicture) -> NDArray:
        """Return how well it is known where an expected picture is seen; nan where not judged.

        The moving arm is not judged, nor what it covers: its joints are loose by more than its
        outline may be off; nor what is strange without a mark.
        """
        points = self._by_link(seen, self.unknown.points, self.unknown.other)
        sigma = reflection_sigma(self.rig, self.mirror, side, seen.depth, points)
        sigma = away_from_the_unknown(np.where(seen.labels == NOTHING, np.nan, sigma))
        strange = False if self.unknown.strange is None else self.unknown.strange[side]
        return np.where(self.covered(side, seen) | strange, np.nan, sigma)

    def covered(self, side: int, seen: LabelledPicture) -> NDArray:
        """Return where the moving arm is expected, or may be as its joints are loose. (h, w)."""
        moving = np.isin(seen.labels, [*self.image.moving])
        # What is nearer moves farther in the picture: a hand held up more than its reflection.
        loose = self.rig.cameras[side].fx * POINT_SIGMA / np.where(moving, seen.depth, np.nan)
        return about_the_loose(loose)
