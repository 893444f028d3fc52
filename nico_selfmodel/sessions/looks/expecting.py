"""What a robot expects to see of itself in a mirror, and how a picture differs from it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.reflection_sigma import reflection_sigma
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.sessions.looks.close_links import near_other_links
from nico_selfmodel.sessions.looks.seen_arm import SeenArm
from nico_selfmodel.systems.rendering.body_image import NOTHING, BodyImage, ExpectedPicture
from nico_selfmodel.systems.rendering.cropped_render import LabelledPicture
from nico_selfmodel.vision.images.body_in_room import seam
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
SEEN_SIGMA = 1.5e-3
"""The same of an arm that was seen, where it is seen directly: its finger is 1.3 mm off [m]."""
APPEARANCE_SIGMA = 0.03
"""What colours and light of the description are not known by, as a share of the grey level; set on
robot 0."""
MOST_UNLIKE = 0.01
"""Share of an unmarked link that may look otherwise once it is known how far it is not known."""
_UNLIKE = 16.27
"""Chi-square of three degrees of freedom that one place in a thousand exceeds by chance."""
TURNED = np.radians(1.0)
"""What links of the arm may be turned by to the light: by which share of its paint's full colour a
place may be lighter or darker, in all colours alike [rad]."""
_LOOSEST = 1.0
"""What of the arm is known by less tells nothing [px]."""


@dataclass(frozen=True, eq=False)
class Unknown:
    """What a body may look otherwise by than expected: standard deviations."""

    points: Mapping[str, float] = field(default_factory=dict)
    """Link -> of its places, each coordinate [m]."""
    other: float = POINT_SIGMA
    """The same of all other links [m]."""
    color: float = APPEARANCE_SIGMA
    """Of colours and light, as a share of the grey level."""
    colors: Mapping[str, float] = field(default_factory=dict)
    """Link -> the same of one that is less well known: how the robot is turned to the light, which
    stands in the room, counts for one more than for another."""
    strange: tuple[NDArray, NDArray] | None = None
    """Pixels of left and right picture about what looks otherwise than expected in a mirror though
    nothing is on it, of which the expected body tells nothing. Shape (h, w) each."""
    untold: frozenset[str] = frozenset()
    """Links of the arm that look otherwise than expected whatever is taken to be unknown: they are
    not judged."""

    def __post_init__(self) -> None:
        """Make the mappings read-only."""
        for name in ("points", "colors"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))


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
    """Of the encoders; where the arm was seen, what they would read there [encoder units]. (n,)."""
    depth: NDArray
    """Along the optical axis to where what is expected seems to be; inf where that is nothing [m].
    Shape (h, w)."""
    arm: SeenArm | None = None
    """How the arm stands, if that was seen."""

    def unlike(self, numbers: Collection[int]) -> float:
        """Return which share of some links does not look as expected; 1 where none is in view.

        Where all sigmas are right it is one place in a thousand, and edges err together.
        """
        return unlike_share((self,), numbers, 1.0)


def unlike_share(
    looks: Sequence[MirrorLook], numbers: Collection[int], unseen: float = 0.0
) -> float:
    """Return which share of some links does not look as expected in all of some looks.

    Args:
        numbers: Of the links, in the pictures.
        unseen: What it is where none of them is judged.
    """
    each = [one.surprise.chi_square[np.isin(one.labels, [*numbers])] for one in looks]
    judged = np.concatenate([places[np.isfinite(places)] for places in each])
    return float(np.mean(judged > _UNLIKE)) if len(judged) else unseen


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

    def judged(
        self, side: int, picture: NDArray, readings: NDArray, arm: SeenArm | None = None
    ) -> MirrorLook:
        """Hold what one camera saw against what is expected.

        Args:
            side: Which camera, 0 or 1.
            picture: What it saw, BGR. Shape (h, w, 3).
            readings: Of the encoders [encoder units]. Shape (n,).
            arm: How the arm stands, if that was seen; it is judged then.

        Raises:
            ValueError: If nothing of the body is in view.
        """
        readings = readings if arm is None else arm.readings
        seen = self.image.expect(readings, self.mirror, side)
        expected = self.expected(side, seen, arm)
        found = surprise(picture, expected)
        places = surprising_places(found)
        return MirrorLook(
            SIDES[side], picture, expected, found, places, seen.labels, readings, seen.depth, arm
        )

    def expected(self, side: int, seen: ExpectedPicture, arm: SeenArm | None = None) -> Expectation:
        """Return an expected picture, what is judged of it, and how well it is known."""
        sigma = self.pixel_sigma(side, seen, arm)
        share = self._by_link(seen, self.unknown.colors, self.unknown.color)
        paint_sigma = np.append(self.image.paint_sigma, 0.0)  # number -1 is no paint
        share = np.hypot(share, paint_sigma[seen.paints])
        moving = np.isin(seen.labels, [*self.image.moving])
        full = np.append(self.image.colors.mean(axis=1), 0.0)[seen.paints[moving]]
        level = bgr_of_rgba(seen.color)[moving].mean(axis=1) / 255.0
        light = np.zeros(share.shape)
        light[moving] = TURNED * full / np.maximum(level, 0.01)
        return Expectation(bgr_of_rgba(seen.color), sigma, self.noise[side], share, light)

    def _by_link(self, seen: LabelledPicture, known: Mapping[str, float], other: float) -> NDArray:
        """Return what is known of each link at each pixel that shows it. Shape (h, w)."""
        each = np.full(seen.labels.shape, other)
        for number, name in self.image.links.items():
            if name in known:
                each[seen.labels == number] = known[name]
        return each

    def pixel_sigma(self, side: int, seen: LabelledPicture, arm: SeenArm | None = None) -> NDArray:
        """Return how well it is known where an expected picture is seen; nan where not judged.

        An arm that was not seen is not judged, nor what it covers: its joints are loose by more
        than its outline may be off. Of one that was seen neither is what is before the glass, what
        its joints leave open by more than a pixel, where it meets the body, where its links lie so
        close together that either may hide the other, and its hand, to which things are attached.
        Nor is judged what is strange without a mark.
        """
        points = self._by_link(seen, self.unknown.points, self.unknown.other)
        numbers = {name: number for number, name in self.image.links.items()}
        loose = None if arm is None else arm.loose(seen.labels, numbers)
        sigma = reflection_sigma(self.rig, self.mirror, side, seen.depth, points, loose)
        placed, untold = None, np.zeros(seen.labels.shape, dtype=bool)
        if arm is not None:
            placed = np.isin(seen.labels, [*self.image.moving])
            placed &= np.nan_to_num(sigma, nan=np.inf) <= _LOOSEST
            sigma = _with_edges(sigma, placed)
            links = [numbers[link] for link in self.unknown.untold | arm.hand]
            untold = seam(placed, (seen.labels != NOTHING) & ~placed, seen.depth) | placed & (
                arm.attached[side] | np.isin(seen.labels, links)
            )
            untold |= self._may_be_hidden(side, seen, placed & ~untold & np.isfinite(sigma), arm)
        sigma = np.where((seen.labels == NOTHING) | untold, np.nan, sigma)
        strange = False if self.unknown.strange is None else self.unknown.strange[side]
        hidden = self.covered(side, seen, placed) | strange
        return np.where(hidden, np.nan, away_from_the_unknown(sigma))

    def _may_be_hidden(
        self, side: int, seen: LabelledPicture, placed: NDArray, arm: SeenArm
    ) -> NDArray:
        """Return where another link of the arm may be before the one that is expected. (h, w)."""
        poses, surfaces = self.image.poses(arm.readings), self.image.surfaces
        names = {k: link for k, link in self.image.links.items() if k in self.image.moving}
        links = {k: (surfaces[n], poses[n]) for k, n in names.items() if n in surfaces}

        def place_sigma(number: int) -> float:
            return self.unknown.points.get(names[number], self.unknown.other)

        rig = MirrorRig(self.rig, self.mirror)
        return near_other_links(rig, side, seen, placed, links, place_sigma)

    def covered(self, side: int, seen: LabelledPicture, placed: NDArray | None = None) -> NDArray:
        """Return where the moving arm is expected, or may be as its joints are loose.

        Args:
            placed: Where it was seen to stand as it is expected, if it was seen. Shape (h, w).

        Returns:
            Truth values. Shape (h, w).
        """
        moving = np.isin(seen.labels, [*self.image.moving])
        if placed is not None:
            moving &= ~placed
        # What is nearer moves farther in the picture: a hand held up more than its reflection.
        sigma = POINT_SIGMA if placed is None else SEEN_SIGMA
        loose = self.rig.cameras[side].fx * sigma / np.where(moving, seen.depth, np.nan)
        return about_the_loose(loose)


def _with_edges(pixel_sigma: NDArray, arm: NDArray) -> NDArray:
    """Return how well places are known where an arm before them may hide them or not.

    Args:
        pixel_sigma: Of each by itself [px]. Shape (h, w).
        arm: What shows the arm. Shape (h, w).

    Returns:
        The same, at least that of the arm within 2.5 of it, and a pixel. Shape (h, w).
    """
    found = np.array(pixel_sigma)
    for sigma in np.unique(pixel_sigma[arm]).tolist():
        near = about_the_loose(np.where(arm & (pixel_sigma == sigma), sigma, np.nan))
        found[near] = np.maximum(found[near], sigma)
    return found
