"""Finds marks on oneself: what two looks into mirrors both put to one place of one link."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mark_place import (
    NOT_ON_ME,
    ON_GLASS,
    ON_ME,
    LinkPlace,
    PosedBody,
    Spot,
    agreeing,
    fused,
    spot_of,
)
from nico_selfmodel.geometry.solids import Solid
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.sessions.known_body import KnownBody
from nico_selfmodel.sessions.mirror_looks import MirrorLook
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.surprise.blobs import FALSE_ALARM, Blob, surprising_places, threshold_of
from nico_selfmodel.vision.surprise.surprise import Surprise

PIXEL_SIGMA = 0.5
"""How well the middle of a spot is known; set on robots 0 and 1 [px]."""
CUT_SIGMA = 1.5
"""The same where a part of the spot may not be judged [px]."""
SURFACE_SIGMA = 5e-4
"""What the surface is not known by; set on robots 0 and 1 [m]."""
_WEAK = 1.0
"""Places of a picture that may surprise where both cameras and both looks must agree."""
_BESIDE = 3
"""Half the side of what must be judged for a place to count as looked at [px]."""
_NEAR = 6.0
"""Surprising places as near to each other are one spot [px]."""


@dataclass(frozen=True, eq=False)
class Finding:
    """One mark."""

    kind: str
    """`ON_ME`, `ON_GLASS` or `NOT_ON_ME`."""
    link: str | None
    """Link that it is on, if on me."""
    p_FM: NDArray | None
    """Where, in that link's frame [m]. Shape (3,)."""
    covariance: NDArray | None
    """Of that. Shape (3, 3)."""
    spots: tuple[Spot, ...]
    """What it was seen as, look by look."""


class MarkFinder:
    """Tells from two looks, in mirrors that stand differently, what marks there are and where.

    A spot is a pair of surprising places, one a camera, whose lines of sight meet
    (`estimation.mirrors.mark_place`). A mark is on me where spots of both looks agree in the frame
    of one link: a spot on the glass moves with the glass, a shadow with the light. One of the four
    places must be so surprising that a picture of what was expected has it once in a hundred times;
    the others need not.
    """

    def __init__(self, image: BodyImage, known: KnownBody) -> None:
        """Take what a robot knows of its body.

        Args:
            image: What it expects of itself, standing as it is known to.
            known: How the body stands, and the mirrors.
        """
        self._image, self._known = image, known

    def find(
        self,
        names: tuple[str, str],
        looks: tuple[tuple[MirrorLook, MirrorLook], tuple[MirrorLook, MirrorLook]],
        changes: tuple[Surprise, Surprise] | None = None,
    ) -> tuple[Finding, ...]:
        """Return all marks that two looks show.

        Args:
            names: Of the mirrors.
            looks: Both cameras' looks into one and the other.
            changes: What has changed in the first look beside the own body, if it is known.

        Returns:
            Marks on me, then those on the glass, then those elsewhere.
        """
        first, second = (
            self._spots(name, pair, both)
            for name, pair, both in zip(names, looks, (changes, None), strict=True)
        )
        found = self._agreed(first, second)
        known = {id(spot) for one in found for spot in one.spots}
        for spots, other, name in ((first, looks[1], names[1]), (second, looks[0], names[0])):
            found += [
                Finding(ON_ME, p.link, p.p_FM, p.own + p.common, (spot,))
                for spot, strong in spots
                if (p := spot.place) is not None and strong and id(spot) not in known
                and not self._judged(p, name, other)
            ]  # fmt: skip
        for kind in (ON_GLASS, NOT_ON_ME):
            found += [
                Finding(kind, None, None, None, (spot,))
                for spot, strong in first
                if spot.kind == kind and strong
            ]
        return tuple(found)

    def _agreed(
        self, first: Sequence[tuple[Spot, bool]], second: Sequence[tuple[Spot, bool]]
    ) -> list[Finding]:
        """Return the marks that both looks put to one place."""
        certain = {id(spot) for spot, strong in (*first, *second) if strong}
        found = []
        for a, b in agreeing(_of(first, ON_ME), _of(second, ON_ME)):
            assert a.place is not None
            assert b.place is not None
            if id(a) in certain or id(b) in certain:
                place, covariance = fused(a.place, b.place)
                found.append(Finding(ON_ME, a.place.link, place, covariance, (a, b)))
        return found

    def _judged(self, place: LinkPlace, name: str, pair: tuple[MirrorLook, MirrorLook]) -> bool:
        """Return whether both cameras of a look judge where a place of the body is seen."""
        X_WF = self._image.poses(pair[0].readings)[place.link]
        rig = MirrorRig(self._known.model.rig, self._known.mirror(name))
        pixels = rig.project(apply(X_WF, place.p_FM[None])[0])
        if not np.isfinite(pixels).all():
            return False
        return all(
            _all_judged(look.surprise, u, v)
            for look, (u, v) in zip(pair, pixels.reshape(2, 2).tolist(), strict=True)
        )

    def _spots(
        self,
        name: str,
        pair: tuple[MirrorLook, MirrorLook],
        changes: tuple[Surprise, Surprise] | None,
    ) -> list[tuple[Spot, bool]]:
        """Return the spots of one look, and whether a place of each is surprising by itself."""
        mirror, rig = self._known.model.mirrors[name], self._known.model.rig
        body = self._body(name, pair[0].readings)
        left, right = (
            _places([look.surprise] if changes is None else [look.surprise, changes[side]])
            for side, look in enumerate(pair)
        )
        cut_left, cut_right = (
            [not _all_judged(look.surprise, a.u, a.v) for a, _ in places]
            for look, places in zip(pair, (left, right), strict=True)
        )
        found = []
        for (a, strong_a), cut_a in zip(left, cut_left, strict=True):
            for (b, strong_b), cut_b in zip(right, cut_right, strict=True):
                sigma = CUT_SIGMA if cut_a or cut_b else PIXEL_SIGMA
                spot = spot_of(np.array([a.u, a.v, b.u, b.v]), sigma, rig, mirror, body)
                if spot is not None:
                    found.append(((spot.kind == NOT_ON_ME, spot.chi_square), spot, a, b,
                                  strong_a or strong_b))  # fmt: skip
        kept: list[tuple[Spot, bool]] = []
        used: list[Blob] = []
        for _, spot, a, b, strong in sorted(found, key=lambda one: one[0]):
            if all(a is not other and b is not other for other in used):
                used += [a, b]
                kept.append((spot, strong))
        return kept

    def _body(self, name: str, readings: NDArray) -> PosedBody:
        """Return the body as it is expected to stand, but for the arm."""
        image, known = self._image, self._known
        moving = {image.links[number] for number in image.moving}
        poses = {k: X for k, X in image.poses(readings).items() if k not in moving}
        solids, links = [], []
        for link, X_WF in poses.items():
            own = image.surfaces[link].solids if link in image.surfaces else ()
            solids += [Solid(one.kind, one.size, X_WF @ one.X_FS) for one in own]
            links += [link] * len(own)
        m = 3 * known.mirrors.index(name)
        rows = [*range(m, m + 3), *range(3 * len(known.mirrors), len(known.covariance))]
        covariance = known.covariance[np.ix_(rows, rows)]
        return PosedBody(solids, links, poses, known.motions(image), covariance, SURFACE_SIGMA)


def _of(spots: Sequence[tuple[Spot, bool]], kind: str) -> list[Spot]:
    return [spot for spot, _ in spots if spot.kind == kind]


def _all_judged(surprise: Surprise, u: float, v: float) -> bool:
    """Return whether all pixels about a place are judged."""
    rows, columns = (slice(max(round(k) - _BESIDE, 0), round(k) + _BESIDE + 1) for k in (v, u))
    window = np.isfinite(surprise.chi_square[rows, columns])
    return bool(window.size and window.all())


def _places(surprises: Sequence[Surprise]) -> list[tuple[Blob, bool]]:
    """Return surprising places of one picture, near ones as one, and which are so by themselves."""
    found: list[tuple[Blob, bool]] = []
    for one in surprises:
        certain = threshold_of(int(np.isfinite(one.chi_square).sum()), FALSE_ALARM)
        found += [(b, b.chi_square > certain) for b in surprising_places(one, _WEAK)]
    merged: list[tuple[Blob, bool]] = []
    for blob, strong in sorted(found, key=lambda one: -one[0].area * one[0].chi_square):
        for k, (other, known) in enumerate(merged):
            if np.hypot(blob.u - other.u, blob.v - other.v) < _NEAR:
                merged[k] = other.with_part(blob), known or strong
                break
        else:
            merged.append((blob, strong))
    return merged
