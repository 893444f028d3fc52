"""Finds marks on oneself: what two looks into mirrors both put to one place of one link."""

from collections.abc import Sequence
from dataclasses import replace

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
    best_spots,
    seen_once,
    spot_of,
)
from nico_selfmodel.estimation.mirrors.other_sight import nearest_depth, other_sights
from nico_selfmodel.estimation.mirrors.painted_disc import painted_disc
from nico_selfmodel.estimation.mirrors.surface_evidence import (
    SurfaceView,
    plainly_shown,
    surprising_together,
)
from nico_selfmodel.geometry.solids.solid import Solid
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.sessions.looks.expecting import MirrorLook
from nico_selfmodel.sessions.looks.finding import Finding, on_me, told_once
from nico_selfmodel.sessions.looks.known_body import KnownBody
from nico_selfmodel.sessions.looks.mirror_looks import PAINT
from nico_selfmodel.sessions.looks.surface_pixels import surface_pixels
from nico_selfmodel.systems.rendering.body_image import BodyImage
from nico_selfmodel.vision.surprise.blobs import FALSE_ALARM, Blob, threshold_of
from nico_selfmodel.vision.surprise.seen_places import (
    all_judged,
    beyond_chance,
    nothing_at,
    reaches,
    seen_places,
    spots_at,
)
from nico_selfmodel.vision.surprise.spot_middle import Middle, middle_of
from nico_selfmodel.vision.surprise.surprise import Surprise

PIXEL_SIGMA = 0.08
"""What the middle of a spot is not known by in each look, besides its fit; set on robots 900 and
950 [px]."""

DISC_SIGMA = 0.03
"""What the disc of paint in each picture is not known by by itself, besides its fit; set on robot
1846 [px]."""
LINK_SIGMA = 1e-4
"""What the place of a mark on the arm or the trunk is not known by besides, each coordinate: where
the learned arm, or the search for how the body stands, has the frame of the link that it is on,
alike in all looks, another for each robot; set on 33 places on arms of robots 1934 to 1951, and
taken for the trunk, too, on 49 on chests of 1973 to 1979, 1984 and 1985 [m]."""

Pair = tuple[MirrorLook, MirrorLook]
Told = list[tuple[Spot, bool]]
"""Spots of a look, and whether one of their places surprises by itself."""


class MarkFinder:
    """Tells from two looks, in mirrors that stand differently, what marks there are and where.

    A spot is a pair of surprising places, one a camera, whose lines of sight meet
    (`estimation.mirrors.mark_place`). A mark is on me where spots of both looks agree in the frame
    of one link: a spot on the glass moves with the glass, a shadow with the light; or where one
    look has a spot, and the other does not tell against it (`_unrefuted`). What one look shows
    directly and in the mirror is one spot (`seen_once`), and discs that have one middle are one
    mark (`told_once`). One of the four places must be so surprising that a picture of what was
    expected has it once in a hundred times, or all of them together must be
    (`surprising_together`).
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
        looks: tuple[Pair, Pair],
        changes: tuple[Surprise, Surprise] | None = None,
    ) -> tuple[Finding, ...]:
        """Return all marks that two looks show.

        Args:
            looks: Both cameras' looks into one and the other.
            changes: What has changed in the first look where the expected body does not judge, if
                it is known.

        Returns:
            Marks on me, then those on the glass, then those elsewhere.
        """
        rest = (None, None, None, None) if changes is None else (*changes, None, None)
        views = self._views(names, looks, rest)
        together = surprising_together(views, _together_bound)
        first = self._spots(names[0], looks[0], changes, together[:2], views[:2])
        second = self._spots(names[1], looks[1], None, together[2:], views[2:])
        found = self._agreed(first, second)
        known = {id(spot) for one in found for spot in one.spots}
        seen = [look.surprise for look in looks[0]]
        if changes is not None:
            seen = [
                Surprise(own.places_beside(rest), own.gain)
                for own, rest in zip(seen, changes, strict=True)
            ]
        others = ((views[2:], [look.surprise for look in looks[1]]), (views[:2], seen))
        for spots, (other, judged) in zip((first, second), others, strict=True):
            found += [
                on_me(p, (spot,))
                for spot, strong in spots
                if (p := spot.place) is not None and strong and id(spot) not in known
                and self._unrefuted(p, other, judged)
            ]  # fmt: skip
        found = told_once(
            [self._middled(one, views, [*looks[0], *looks[1]], rest) for one in found]
        )
        for kind in (ON_GLASS, NOT_ON_ME):
            found += [
                Finding(kind, None, None, None, (spot,))
                for spot, strong in first
                if spot.kind == kind and strong
            ]
        return tuple(found)

    def _views(
        self,
        names: Sequence[str],
        looks: Sequence[Pair],
        changes: Sequence[Surprise | None] = (None, None, None, None),
    ) -> list[SurfaceView]:
        """Return all pictures as views of the own surface, but for an arm that was not seen.

        What lies at an outline, where the expected body does not judge, has changed or not.
        """
        views, rest = [], iter(changes)
        for name, pair in zip(names, looks, strict=True):
            rig = MirrorRig(self._known.model.rig, self._known.mirror(name))
            posed, image = self._image.poses(pair[0].readings), self._image
            hidden = image.moving if pair[0].arm is None else ()
            poses = {k: posed[link] for k, link in image.links.items() if k not in hidden}
            for side, look in enumerate(pair):
                change = next(rest)
                own = look.surprise if change is None else look.surprise.beside(change)
                assert own.off is not None
                assert own.covariance is not None
                judged = np.isfinite(own.chi_square)
                body = np.isin(look.labels[judged], [*poses])
                places = np.where(np.isin(look.labels, [*poses]), own.chi_square, np.nan)
                # What is compared with an earlier picture is expected wrongly in no other.
                expected = np.isfinite(look.surprise.chi_square[judged][body])
                alike = np.where(expected[:, None, None], own.alike(body), 0.0)
                rows = own.off[body], own.covariance[body], alike
                views.append(SurfaceView(side, rig, places, *rows, look.depth, look.labels, poses))
        return views

    def _agreed(self, first: Told, second: Told) -> list[Finding]:
        """Return the marks that both looks put to one place."""
        certain = {id(spot) for spot, strong in (*first, *second) if strong}
        found = []
        for a, b in agreeing(_of(first, ON_ME), _of(second, ON_ME)):
            assert a.place is not None
            assert b.place is not None
            if id(a) in certain or id(b) in certain:
                better = min(a.place, b.place, key=lambda place: np.trace(place.own))
                found.append(on_me(better, (a, b)))
        return found

    def _middled(
        self,
        found: Finding,
        views: Sequence[SurfaceView],
        looks: Sequence[MirrorLook],
        changes: Sequence[Surprise | None],
    ) -> Finding:
        """Return a mark on me with its middle by all pictures of the surface about it."""
        assert found.link is not None
        assert found.p_FM is not None
        surface = self._image.surfaces[found.link]
        number = self._number(found.link)
        each = [
            surface_pixels(found.p_FM, number, surface, *one)
            for one in zip(views, looks, changes, strict=True)
        ]
        p_FM, own = painted_disc(
            [one for one in each if one is not None],
            surface.solids,
            found.p_FM,
            DISC_SIGMA,
            PAINT,
        )
        places = [spot.place for spot in found.spots if spot.place is not None]
        common = np.mean([place.common for place in places], axis=0)
        loose = np.mean([place.loose for place in places], axis=0) / len(places)
        return replace(found, p_FM=p_FM, covariance=own + common + loose)

    def _number(self, link: str) -> int:
        (number,) = (k for k, name in self._image.links.items() if name == link)
        return number

    def _unrefuted(
        self, place: LinkPlace, views: Sequence[SurfaceView], surprises: Sequence[Surprise]
    ) -> bool:
        """Return whether another look does not tell against a mark that it does not find.

        It does not where a camera cannot judge where the mark should be seen, or sees it from the
        side or something else there, as where an arm has turned that side of it away; nor where one
        camera sees something there beyond chance, and the other, which sees it from the side or
        against a colour that it is like, judges where it should see it on the glass, and shows
        nothing there.
        """
        rig, label = views[0].rig, self._number(place.link)
        (n_F,) = self._image.surfaces[place.link].normals(place.p_FM[None])
        if not all(plainly_shown(view, label, place.p_FM, n_F) for view in views):
            return True
        X_WF = views[0].poses[label]
        at = rig.project(apply(X_WF, place.p_FM[None])[0]).reshape(2, 2).tolist()
        if not all(all_judged(one, u, v) for one, (u, v) in zip(surprises, at, strict=True)):
            return True
        for side, (u, v) in enumerate(at):
            for blob in spots_at(surprises[side], u, v):
                glass = other_sights(rig, side, [(blob.u, blob.v)], [np.nan])
                if len(glass) and nothing_at(surprises[1 - side], *glass[0].tolist()):
                    return True
        return False

    def _spots(
        self,
        name: str,
        pair: Pair,
        changes: tuple[Surprise, Surprise] | None,
        together: Sequence[NDArray],
        views: Sequence[SurfaceView],
    ) -> Told:
        """Return the spots of one look, and whether they are beyond chance.

        They are where a place of one picture is by itself, or that of both together: of n places
        of the body in one each has some hundred that it may be in the other.
        """
        mirror, rig = self._known.model.mirrors[name], self._known.model.rig
        body = self._body(name, pair[0])
        rest = (None, None) if changes is None else changes
        shown = [view.judged for view in views]
        sights = self._sights(name, pair, rest, together, shown)
        left, right = (
            self._middles(look, rest[side], together[side], sights[1 - side], shown[side])
            for side, look in enumerate(pair)
        )
        places = max(int(one.sum()) for one in shown)
        found, both = [], set()
        for a, one, strong_a in left:
            for b, other, strong_b in right:
                sigma = float(np.hypot(PIXEL_SIGMA, max(one.sigma, other.sigma)))
                pixels = np.array([one.u, one.v, other.u, other.v])
                spot = spot_of(pixels, sigma, rig, mirror, body)
                if spot is None or (spot.kind == NOT_ON_ME and self._on_arm(pair, a, b)):
                    continue
                found.append((spot, (a, strong_a), (b, strong_b)))
                alike = [
                    k.surprise.share_alike(p.u, p.v) for k, p in zip(pair, (a, b), strict=True)
                ]
                if spot.kind == ON_ME and beyond_chance(a, b, places, min(alike)):
                    both.add(id(spot))
        return seen_once([(spot, strong or id(spot) in both) for spot, strong in best_spots(found)])

    def _sights(
        self,
        name: str,
        pair: Pair,
        changes: Sequence[Surprise | None],
        together: Sequence[NDArray],
        shown: Sequence[NDArray],
    ) -> list[list[tuple[float, float]]]:
        """Return where the other camera must see what surprises beyond chance in each picture."""
        rig, found = MirrorRig(self._known.model.rig, self._known.mirror(name)), []
        for side, look in enumerate(pair):
            seen = seen_places(look.surprise, changes[side], together[side], (), shown[side])
            spots = [blob for blob, strong in seen if strong]
            depths = [nearest_depth(look.depth, blob.u, blob.v) for blob in spots]
            pixels = np.array([(blob.u, blob.v) for blob in spots]).reshape(-1, 2)
            sights = other_sights(rig, side, pixels, depths)
            found.append([(float(u), float(v)) for u, v in sights])
        return found

    @staticmethod
    def _middles(
        look: MirrorLook,
        change: Surprise | None,
        together: NDArray,
        where: Sequence[tuple[float, float]],
        shown: NDArray,
    ) -> list[tuple[Blob, Middle, bool]]:
        """Return the spots of one picture, their middles, and whether each is surprising."""
        parts = [look.surprise] if change is None else [look.surprise, change]
        return [
            (blob, middle_of(blob, look.picture, parts), strong)
            for blob, strong in seen_places(look.surprise, change, together, where, shown)
        ]

    def _on_arm(self, pair: Pair, a: Blob, b: Blob) -> bool:
        """Return whether a camera expects the arm there: paint on it may seem to be beside it.

        What is seen at its outline may have its middle beside it.
        """
        moving = [*self._image.moving]
        return any(
            reaches(one, np.isin(look.labels, moving))
            for look, one in zip(pair, (a, b), strict=True)
        )

    def _body(self, name: str, look: MirrorLook) -> PosedBody:
        """Return the body as it is expected to stand, but for an arm that was not seen."""
        image, known, arm = self._image, self._known, look.arm
        hidden = {image.links[number] for number in image.moving} if arm is None else set()
        poses = {k: X for k, X in image.poses(look.readings).items() if k not in hidden}
        solids, links = [], []
        for link, X_WF in poses.items():
            own = image.surfaces[link].solids if link in image.surfaces else ()
            solids += [Solid(one.kind, one.size, X_WF @ one.X_FS) for one in own]
            links += [link] * len(own)
        # A head is known as well as its pictures tell, which its covariance says.
        ways = known.motions(image)
        turned = {link for motion, moved in ways if len(moved) < len(image.links) for link in moved}
        arm_links = {image.links[number] for number in image.moving}
        place_sigma = {link: 0.0 if link in turned - arm_links else LINK_SIGMA for link in poses}
        m = 3 * known.mirrors.index(name)
        rows = [*range(m, m + 3), *range(3 * len(known.mirrors), len(known.covariance))]
        covariance = known.covariance[np.ix_(rows, rows)]
        loose = ((), np.zeros((0, 0))) if arm is None else (arm.motions, arm.covariance)
        return PosedBody(solids, links, poses, ways, covariance, place_sigma, *loose)


def _of(spots: Told, kind: str) -> list[Spot]:
    return [spot for spot, _ in spots if spot.kind == kind]


def _together_bound(places: int, freedom: int) -> float:
    return threshold_of(places, FALSE_ALARM, freedom)
