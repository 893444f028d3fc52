"""Where a spot is that both cameras see: on the body in the mirror, on the glass, or elsewhere.

Two lines of sight tell a point: for what is seen directly it is the spot itself, for a reflection
its mirror image behind the glass. Three hypotheses are held against it by chi-square: it lies on
the body's surface, or its reflection does where it is behind the glass; it lies on the glass
itself; or neither.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.estimation.mirrors.body_alignment import BodyMotion
from nico_selfmodel.geometry.reflection import reflect, reflection_slopes
from nico_selfmodel.geometry.solids.solid import (
    Solid,
    distance_to_solids,
    normals_of_solids,
    onto_solids,
)
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.mirror import Mirror, plane_of_values
from nico_selfmodel.model.cameras.stereo_rig import StereoRig

_T = TypeVar("_T")
ON_ME, ON_GLASS, NOT_ON_ME = "on me", "on the glass", "not on me"
"""What a spot can be."""
GATE_1, GATE_3 = 10.828, 16.266
"""What a chi-square of one and of three degrees of freedom exceeds once in a thousand times."""
_PART = 0.5
"""What the middle of a spot may be off by of which a picture shows a part; set on robots 0 and 1
[px]."""
_BEFORE = 0.1
"""So far before what is seen directly begins what may hide it: cameras look out of a head [m]."""
_BEHIND = 0.01
"""What is hidden lies farther behind what is seen than this, which an outline may [m]."""
_STEPS = 20
_ARRIVED = 1e-6
"""Steps along the surface below which its nearest point is found [m]."""


@dataclass(frozen=True, eq=False)
class PosedBody:
    """The own body as it is expected to stand, in the rig's world."""

    solids: Sequence[Solid]
    """All that it is made of, posed there."""
    links: Sequence[str]
    """Link of each solid."""
    poses: Mapping[str, NDArray]
    """Link -> its pose. Shape (4, 4)."""
    motions: Sequence[tuple[BodyMotion, frozenset[str]]]
    """How it may stand elsewhere, and the links that each of it moves."""
    covariance: NDArray
    """Of the mirror's values, then of the motions. Shape (3 + k, 3 + k)."""
    place_sigma: Mapping[str, float]
    """Link -> what its place is not known by besides, each coordinate [m]."""
    loose: Sequence[tuple[BodyMotion, frozenset[str]]] = ()
    """How it may stand elsewhere in this look alone, as an arm whose joints are loose, and the
    links that each of it moves."""
    loose_covariance: NDArray = field(default_factory=lambda: np.zeros((0, 0)))
    """Of that. Shape (j, j)."""


@dataclass(frozen=True, eq=False)
class LinkPlace:
    """Where on a link a spot is, in that link's frame."""

    link: str
    """Name of the link."""
    p_FM: NDArray
    """The place [m]. Shape (3,)."""
    own: NDArray
    """Its covariance from what is this look's alone. Shape (3, 3)."""
    common: NDArray
    """The same from mirror, body and surface, which err alike in all looks. Shape (3, 3)."""
    loose: NDArray
    """What of `own` is from where the link stands in this look. Shape (3, 3)."""
    in_part: NDArray
    """What stands for `own` where one asks whether two looks show one spot, of which either may
    show a part: half a pixel at least, and not along the surface only, for parts may lie on two
    faces of it. Shape (3, 3)."""

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("p_FM", "own", "common", "loose", "in_part"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


@dataclass(frozen=True, eq=False)
class Spot:
    """What a spot in both pictures is."""

    kind: str
    """`ON_ME`, `ON_GLASS` or `NOT_ON_ME`."""
    place: LinkPlace | None
    """Where on a link, if on me."""
    chi_square: float
    """Of what it is, one degree of freedom; for `NOT_ON_ME` that of the best other kind."""
    directly: bool = False
    """Whether it was seen before the glass."""


def spot_of(
    pixels: NDArray, sigma: float, rig: StereoRig, mirror: Mirror, body: PosedBody
) -> Spot | None:
    """Tell what a pair of pixels shows, of the body itself or of its reflection.

    Whether the pixels are of one point, and on what, is asked with at least `_PART` a pixel: weak
    spots are seen in part, and a mark that is thrown away is never found again. What may be on the
    glass and on the body, as where the middle of a spot in parts is not known to pixels, is where
    it fits better.

    Args:
        pixels: Left u, v and right u, v [px]. Shape (4,).
        sigma: How well the middle of the spot is known in each picture [px].
        body: The own body.

    Returns:
        The spot; None where the pixels are not of one point.
    """
    asked = max(sigma, _PART)
    found = rig.triangulate(pixels[None], asked)
    p_WQ, covariance = found.p_WQ[0], found.covariance[0]
    if not (found.in_front[0] and np.isfinite(p_WQ).all()):
        return None
    off = found.residuals[0]
    if float(off @ off) / asked**2 > GATE_1:
        return None
    plane, by_values = plane_of_values(mirror.values, rig.left.X_WC)
    by_plane = np.append(p_WQ, 1.0) @ by_values
    known = body.covariance[:3, :3]
    variance = plane.normal @ covariance @ plane.normal + by_plane @ known @ by_plane
    height = float(plane.distance_to(p_WQ))
    on_glass, directly = height**2 / float(variance), height > 0.0
    if directly:
        sight = _Sight.before_the_glass(p_WQ, covariance, rig)
    else:
        sight = _Sight.in_mirror(p_WQ, covariance, mirror, rig)
    on_me = _on_body(sight, (sigma / asked) ** 2, body)
    if on_glass < GATE_1 and (on_me is None or on_glass <= on_me.chi_square):
        return Spot(ON_GLASS, None, on_glass, directly)
    if on_me is None or on_me.chi_square > GATE_1:
        best = on_glass if on_me is None else min(on_glass, on_me.chi_square)
        return Spot(NOT_ON_ME, None, best, directly)
    return replace(on_me, directly=directly)


@dataclass(frozen=True, eq=False)
class _Sight:
    """A spot where it would be if it is on the body, in the rig's world."""

    p_WQ: NDArray
    """The spot [m]. Shape (3,)."""
    covariance: NDArray
    """By its pixels. Shape (3, 3)."""
    p_WC: NDArray
    """Where one looks from [m]. Shape (3,)."""
    by_mirror: NDArray
    """How the spot moves with the mirror's values. Shape (3, 3)."""

    @classmethod
    def before_the_glass(cls, p_WQ: NDArray, covariance: NDArray, rig: StereoRig) -> "_Sight":
        """Take a spot that is seen directly."""
        way = p_WQ - np.mean([camera.X_WC[:3, 3] for camera in rig.cameras], axis=0)
        p_WC = p_WQ - _BEFORE * way / np.linalg.norm(way)
        return cls(p_WQ, covariance, p_WC, np.zeros((3, 3)))

    @classmethod
    def in_mirror(
        cls, behind: NDArray, covariance: NDArray, mirror: Mirror, rig: StereoRig
    ) -> "_Sight":
        """Take the spot whose mirror image is seen behind the glass."""
        plane, by_values = plane_of_values(mirror.values, rig.left.X_WC)
        turned = np.eye(3) - 2.0 * np.outer(plane.normal, plane.normal)
        p_WC = reflect(plane, np.mean([camera.X_WC[:3, 3] for camera in rig.cameras], axis=0))
        slopes = reflection_slopes(plane, behind[None])[0] @ by_values
        return cls(reflect(plane, behind), turned @ covariance @ turned.T, p_WC, slopes)


def _on_body(sight: _Sight, share: float, body: PosedBody) -> Spot | None:
    """Put a spot on the nearest surface, by what it is known by.

    With the spot p of covariance C it is the x that minimises (x - p)' C^-1 (x - p) on the surface
    n.(x - s) = 0: a Kalman step with gain k = C n / n'Cn, anew from the surface at each x, from p
    and from what the cameras see in its way: p may lie so deep inside that the nearest surface is
    one's back, or that of another of the shapes that overlap there. A link that stands elsewhere by
    d shifts it in the link's frame by (1 - k n') d.

    Args:
        share: Of C that is this look's alone.
    """
    p, C, p_WC, slopes = sight.p_WQ, sight.covariance, sight.p_WC, sight.by_mirror
    ends = [_onto_surface(start, p, C, body) for start in (p, _first(p_WC, p, body))]
    seen = [end for end in ends if end is not None and not _hidden(end[0], p_WC, body)]
    if not seen:
        return None
    x, normal, off, variance = min(seen, key=lambda end: end[2] ** 2 / end[3])
    gain = C @ normal / variance
    link = body.links[int(distance_to_solids(body.solids, x[None])[1][0])]
    X_FW = inverse(body.poses[link])
    onto = np.eye(3) - np.outer(gain, normal)
    ways, loose_ways = (
        [-motion.way(x[None])[0] if link in links else np.zeros(3) for motion, links in motions]
        for motions in (body.motions, body.loose)
    )
    by_known = X_FW[:3, :3] @ onto @ np.column_stack([slopes, *ways])
    by_pixels = onto @ C @ onto.T
    by_loose = np.zeros((3, 0)) if not loose_ways else onto @ np.column_stack(loose_ways)
    loose = by_loose @ body.loose_covariance @ by_loose.T
    by_surface = body.place_sigma[link] ** 2 * onto @ onto.T
    R_FW = X_FW[:3, :3]
    place = LinkPlace(
        link,
        apply(X_FW, x[None])[0],
        R_FW @ (share * by_pixels + loose) @ R_FW.T,
        R_FW @ by_surface @ R_FW.T + by_known @ body.covariance @ by_known.T,
        R_FW @ loose @ R_FW.T,
        R_FW @ (C + loose) @ R_FW.T,
    )
    variance += body.place_sigma[link] ** 2 + _common_along(normal, slopes, ways, body)
    if loose_ways:
        along = normal @ np.column_stack(loose_ways)
        variance += float(along @ body.loose_covariance @ along)
    return Spot(ON_ME, place, off**2 / variance)


def _onto_surface(
    x: NDArray, p: NDArray, C: NDArray, body: PosedBody
) -> tuple[NDArray, NDArray, float, float] | None:
    """Return the x that is best for p by steps from a start, n, n.(x - p) and n'Cn; None if none.

    A start where no body is seen is nan.
    """
    if not np.isfinite(x).all():
        return None
    for _ in range(_STEPS):
        distance = float(distance_to_solids(body.solids, x[None])[0][0])
        normal = normals_of_solids(body.solids, x[None])[0]
        variance = float(normal @ C @ normal)
        off = float(normal @ (x - p) - distance)
        last, x = x, p + C @ normal * (off / variance)
        if np.linalg.norm(x - last) < _ARRIVED:
            return x, normal, off, variance
    return None


def _first(p_WC: NDArray, x: NDArray, body: PosedBody) -> NDArray:
    """Return what of the body is seen from a camera in the way of a place; nan if nothing is."""
    return onto_solids(body.solids, p_WC[None], (x - p_WC) / np.linalg.norm(x - p_WC))[0]


def _hidden(x: NDArray, p_WC: NDArray, body: PosedBody) -> bool:
    """Return whether something of the body is in the way from a camera to a place."""
    way = (x - p_WC) / np.linalg.norm(x - p_WC)
    return float((x - _first(p_WC, x, body)) @ way) > _BEHIND  # not where nothing is


def _common_along(
    normal: NDArray, slopes: NDArray, ways: Sequence[NDArray], body: PosedBody
) -> float:
    """Return the variance of mirror and body along a normal [m^2]."""
    by = normal @ np.column_stack([slopes, *ways])
    return float(by @ body.covariance @ by)


def agreeing(first: Sequence[Spot], second: Sequence[Spot]) -> tuple[tuple[Spot, Spot], ...]:
    """Return which spots on the body two looks put to one place of one link.

    Args:
        first: Of one look.
        second: Of another, in a mirror that stands elsewhere.

    Returns:
        Pairs, each spot in one at most, the best first.
    """
    pairs = [(_apart(a.place, b.place), a, b, (a, b)) for a in first for b in second]
    return tuple(_each_once([pair for pair in pairs if pair[0] < GATE_3]))


def best_spots(
    found: Sequence[tuple[Spot, tuple[object, bool], tuple[object, bool]]],
) -> list[tuple[Spot, bool]]:
    """Return what the surprising places of two pictures show, each place in one spot at most.

    What is beyond chance in both pictures is not left for a place that chance makes in one of them,
    which may make anything of it; then what is on me or the glass comes first.

    Args:
        found: Spots, and of which place each is in one picture and in the other, and whether that
            is beyond chance.

    Returns:
        Spots, and whether one of their places is.
    """
    pairs = []
    for spot, (a, sure), (b, certain) in found:
        worse = not (sure and certain), spot.kind == NOT_ON_ME, spot.chi_square
        pairs.append((worse, a, b, (spot, sure or certain)))
    return _each_once(pairs)


def seen_once(spots: Sequence[tuple[Spot, bool]]) -> list[tuple[Spot, bool]]:
    """Return the spots of one look without those seen directly whose reflection is one of them.

    Who does not know that they are one takes them for two. The reflection stays, and is beyond
    chance where either of both is.

    Args:
        spots: And whether each is beyond chance.
    """
    sure = {id(spot): strong for spot, strong in spots}
    on_me = [spot for spot, _ in spots if spot.kind == ON_ME]
    direct = [spot for spot in on_me if spot.directly]
    reflected = [spot for spot in on_me if not spot.directly]
    for image, again in agreeing(reflected, direct):
        sure[id(image)] |= sure.pop(id(again))
    return [(spot, sure[id(spot)]) for spot, _ in spots if id(spot) in sure]


def _each_once(pairs: Sequence[tuple[Any, object, object, _T]]) -> list[_T]:
    """Return what pairs stand for, the least first, none of two in two of them."""
    found: list[_T] = []
    used: set[int] = set()
    for _, a, b, meant in sorted(pairs, key=lambda pair: pair[0]):
        if used.isdisjoint((id(a), id(b))):
            used |= {id(a), id(b)}
            found.append(meant)
    return found


def _apart(a: LinkPlace | None, b: LinkPlace | None) -> float:
    """Return the chi-square of two places, of three degrees of freedom; inf on two links."""
    if a is None or b is None or a.link != b.link:
        return np.inf
    off = a.p_FM - b.p_FM
    return float(off @ np.linalg.solve(a.in_part + b.in_part + a.common + b.common, off))
