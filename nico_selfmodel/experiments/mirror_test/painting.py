"""Who paints marks in the mirror test: on the robot, on the glass, on another robot, or not.

It knows where everything really is, and tells the robot nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.arrays import read_only
from nico_selfmodel.errors import RobotError
from nico_selfmodel.geometry.reflection import reflect
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.sessions.mirrors.knowing import LINKS, MARKED
from nico_selfmodel.systems.looking import LOOKING_DEG
from nico_selfmodel.systems.rendering.mark_on_body import GLASS, Mark, recolored
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.other_robot import OTHER
from nico_selfmodel.systems.stations.seen_surface import SeenSurface

DIAMETER = 0.010
"""Of the marks [m]."""
STEP = 0.2
"""Of the colour, Euclidean in RGB of 1, in a random direction."""
MARK, SHAM_PAINT, SHAM_ACT = "mark", "sham, own colour", "sham, no paint"
ON_THE_GLASS, OTHER_ROBOT = "mark on the glass", "mark on another robot"
SEEN_DIRECTLY = "mark seen directly, too"
KINDS = (
    *(MARK, SHAM_PAINT, MARK, ON_THE_GLASS, MARK, SHAM_ACT, MARK, OTHER_ROBOT),
    SEEN_DIRECTLY,
)
"""What is done in turn; who runs trials shuffles it."""
_BESIDE = 0.40
"""Distance of the other robot to the right, where the mirror shows it too [m]."""
_RING = 16
_NEAR = 12.0
"""How far from where its middle is reflected a mark is seen in the mirror [px]."""


def _beside() -> NDArray:
    """Return the pose of a robot that stands beside the first one. Shape (4, 4)."""
    gaze = np.radians(LOOKING_DEG["neck_yaw"])
    X_WO = np.eye(4)
    X_WO[:2, 3] = -_BESIDE * np.array([-np.sin(gaze), np.cos(gaze)])
    return X_WO


STANDING_BESIDE = read_only(_beside())
"""Pose of the other robot's root in that of the first. Shape (4, 4)."""


@dataclass(frozen=True, eq=False)
class Painted:
    """What was done in a trial."""

    kind: str
    """One of `KINDS`."""
    mark: Mark | None
    """The mark; None where nothing was painted."""
    normal: NDArray | None = None
    """Of the surface at it, in the frame of its link; None on glass. Shape (3,)."""


class NoPlaceError(RobotError):
    """Nothing that is to be painted could be seen from where the robots stand."""


class Painter:
    """Paints on one station, at places that both cameras see in the mirror.

    Neither sees them directly, unless that is asked for; then both do.

    Paint that changes either picture by less than the noise of a pixel, as where no light falls, is
    not to be seen: it is wiped off, and another place is taken.
    """

    def __init__(self, station: NicoStation, context: Any, X_BM: NDArray, noise: float) -> None:
        """Take a station.

        Args:
            X_BM: Where its mirror stands, in the frame of the arm's base. Shape (4, 4).
            noise: Of its pictures [grey levels].
        """
        self._station, self._context, self._noise = station, context, noise
        self._X_LM = station.ground_truth.X_LB @ X_BM
        self._mirror = station.ground_truth.mirror(X_BM).plane

    def paint(self, kind: str, rng: np.random.Generator) -> Painted:
        """Do what a trial asks for.

        Args:
            kind: One of `KINDS`.

        Raises:
            NoPlaceError: If there is no such place.
        """
        if kind == SHAM_ACT:
            return Painted(kind, None)
        surfaces = self._station.surfaces_true(self._context)
        if kind != OTHER_ROBOT:
            surfaces = {k: v for k, v in surfaces.items() if not k.startswith(OTHER)}
        seen = SeenSurface(surfaces, self._station.ground_truth.rig, self._mirror)
        links = [OTHER + link for link in LINKS] if kind == OTHER_ROBOT else list(MARKED)
        directly = kind == SEEN_DIRECTLY
        places = seen.in_mirror(links, 50, rng, DIAMETER, directly=directly)
        before = self._pictures()
        for link, p_FQ in zip(places.links, places.p_FQ, strict=True):
            surface, X_LF = surfaces[link]
            color = surface.color(p_FQ)
            if kind == SHAM_PAINT:
                if not _one_color(surface, p_FQ):
                    continue
                mark = Mark(link, p_FQ, DIAMETER, color)
            elif kind == ON_THE_GLASS:
                p_MQ = self._on_glass(apply(X_LF, p_FQ[None])[0])
                mark = Mark(GLASS, p_MQ, DIAMETER, recolored(color, STEP, rng))
            else:
                mark = Mark(link, p_FQ, DIAMETER, recolored(color, STEP, rng))
            try:
                self._station.paint(self._context, mark)
            except RobotError:
                continue  # in a crease between two shapes no disc lies on the surface
            about = self._reflected(apply(X_LF, p_FQ[None])[0]) if directly else None
            if kind != SHAM_PAINT and self._shown(before, about) < self._noise:
                self._station.wipe(self._context)
                continue
            normal = None if mark.link == GLASS else surface.normals(p_FQ[None])[0]
            return Painted(kind, mark, normal)
        raise NoPlaceError(f"no place for a {kind}: the mirror shows no such place to both cameras")

    def _pictures(self) -> list[NDArray]:
        """Return what both cameras see now. Shape (h, w, 3) each."""
        # The pictures of one time are kept; paint does not change the time.
        self._context.SetTime(self._context.get_time())
        return [self._station.picture(self._context, side).astype(float) for side in SIDES]

    def _reflected(self, p_LQ: NDArray) -> NDArray:
        """Return where both cameras see the reflection of a place [px]. Shape (2, 2)."""
        rig = self._station.ground_truth.rig
        return np.asarray(rig.project(reflect(self._mirror, p_LQ)).reshape(2, 2))

    def _shown(self, before: Sequence[NDArray], about: NDArray | None = None) -> float:
        """Return what paint changes in a picture, in that which it changes less [grey levels].

        Within one frame the noise of pictures stays the same, so that all that changes is paint.

        Args:
            before: Pictures without paint.
            about: Where it must be seen, if it is seen elsewhere, too [px]. Shape (2, 2).
        """
        found = []
        for side, (old, new) in enumerate(zip(before, self._pictures(), strict=True)):
            square = np.mean((new - old) ** 2, axis=2)
            changed = square > 0.0
            if about is not None:
                v, u = np.indices(changed.shape)
                changed &= np.hypot(u - about[side, 0], v - about[side, 1]) < _NEAR
            found.append(float(np.sqrt(square[changed].mean())) if changed.any() else 0.0)
        return min(found)

    def _on_glass(self, p_LQ: NDArray) -> NDArray:
        """Return where the left camera sees a reflection in the glass, in its frame. Shape (3,)."""
        behind = p_LQ - 2.0 * self._mirror.distance_to(p_LQ) * self._mirror.normal
        share = self._mirror.offset / (self._mirror.offset - self._mirror.distance_to(behind))
        return apply(inverse(self._X_LM), (share * behind)[None])[0] * [1.0, 1.0, 0.0]


def _one_color(surface: Any, p_FQ: NDArray) -> bool:
    """Return whether a mark would lie on one colour only."""
    normal = surface.normals(p_FQ[None])[0]
    turn = 2.0 * np.pi * np.arange(_RING) / _RING
    aside = np.linalg.svd(normal[None])[2][1:]
    ring = p_FQ + 0.6 * DIAMETER * (np.stack([np.cos(turn), np.sin(turn)], axis=1) @ aside)
    return all(np.array_equal(surface.color(p), surface.color(p_FQ)) for p in ring)
