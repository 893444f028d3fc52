"""A Nico that looks at its head and chest in many mirrors, to learn their shape."""

from collections.abc import Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import EstimationError
from nico_selfmodel.estimation.mirrors.mirror import MirrorCalibration, calibrate_mirrors
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import reflected_projection
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.sessions.looks.known_body import Shot
from nico_selfmodel.sessions.looks.mirror_looks import MirrorLooks
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import NicoBeforeMirrors
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate

_TILTS = tuple((x, y) for y in (-24.0, -8.0, 10.0) for x in (-27.0, -9.0, 9.0, 27.0))
"""How mirrors are turned: face and chest in view, from as many sides as there are [deg]."""
_NEAR, _FAR = 0.22, 0.28
"""How far they are from the left camera, by turns [m]."""
SHAPE_MIRRORS: Mapping[str, Mirror] = MappingProxyType(
    {
        f"shape{k + 1}": Mirror.from_values([*np.radians(tilt), (_NEAR, _FAR)[k % 2]])
        for k, tilt in enumerate(_TILTS)
    }
)
"""Where mirrors are meant to stand."""
HAND_POSES = 4
"""In which the hand tells where each of them stands."""
_SPARE = 5.0
"""Poses planned for each of these: before some mirrors the hand is hardly seen."""
FEWEST_MIRRORS = 6
"""That a shape takes."""
_VAGUE = 4.0
"""A mirror in which it is less well known where the body is seen is left out: pictures are blurred
by as much at first, and do not lead from farther away [px]."""
_CHOICES = 200
_CLEARANCE = 0.03
"""How far the arm's links keep from the glass [m]."""
_DAY = 8


@dataclass(frozen=True, eq=False)
class ShapeLooks:
    """Pictures of head and chest in mirrors whose planes the hand has told."""

    mirrors: Mapping[str, Mirror]
    """With covariances."""
    shots: tuple[Shot, ...]
    """One before each mirror, in the same order."""
    covered: tuple[tuple[NDArray, NDArray], ...]
    """Which pixels of each picture the moving arm may cover. Shape (h, w) each."""
    room: NDArray
    """What the left camera sees without a mirror, BGR. Shape (h, w, 3)."""
    noise: tuple[float, float]
    """Standard deviation of a grey level, of each camera."""


def tell_mirrors(
    nico: RenderedNico,
    model: SelfModel,
    familiar: NDArray,
    plate: MirrorPlate,
    stage: Stage | None = None,
) -> tuple[SelfModel, dict[str, NDArray]]:
    """Learn from the hand where mirrors stand that are put up for the shape.

    Args:
        model: What it has learned of arm and cameras.
        familiar: Readings at which the arm was learned. Shape (K, n).

    Returns:
        The model that knows these mirrors too, and how they err with each other and the cameras;
        and where their glasses really stand, X_BM, shape (4, 4), by name.

    Raises:
        EstimationError: If no plane fits, or hardly any mirror shows the hand.
        ModelError: If hardly any pose shows the hand in one of them.
    """
    before = NicoBeforeMirrors(
        nico, SHAPE_MIRRORS, plate=plate, knows=model, rig=model.rig,
        familiar=familiar, choices=_CHOICES,
    )  # fmt: skip
    told = telling(stage, "looking at its hand in mirrors for its shape")
    # A mirror before which hardly any pose can be reached does without; others tell the shape.
    recorded = before.record("shape", _DAY, HAND_POSES, spare=_SPARE, least=0, progress=told)
    data = shown_enough(recorded)
    found = calibrate_mirrors(data, model)
    open_ones = _left_open(found)
    if open_ones:
        data = _enough(data, [name for name in found.mirrors if name not in open_ones])
        found = calibrate_mirrors(data, model)
    learned = replace(found.model, covariance=found.covariance)
    return learned, {name: before.views[name].X_BM for name in found.mirrors}


def shown_enough(data: Dataset) -> Dataset:
    """Return the rows of mirrors in which both cameras saw the hand once, or one of them twice."""
    sights = np.isfinite(data.pixels[:, ::2]).sum(axis=1)
    return _enough(
        data, [name for name in np.unique(data.mirror) if sights[data.mirror == name].sum() > 1]
    )


def _left_open(found: MirrorCalibration) -> set[str]:
    """Return mirrors of which the hand does not tell all three numbers."""
    uncertainty = found.solution.uncertainty
    known = dict(zip(uncertainty.names, np.isfinite(uncertainty.sigma), strict=True))
    return {name for name in found.mirrors if not all(known[n] for n in Mirror.names_of(name))}


def _enough(data: Dataset, known: Sequence[str]) -> Dataset:
    """Return the rows of some mirrors.

    Raises:
        EstimationError: If they are too few for a shape.
    """
    _require_enough(known)
    return data.select(np.isin(data.mirror, known))


def _require_enough(known: Sized) -> None:
    """Raise an EstimationError if mirrors are too few for a shape."""
    if len(known) < FEWEST_MIRRORS:
        raise EstimationError(
            f"the hand was seen well enough in {len(known)} mirrors, a shape takes "
            f"{FEWEST_MIRRORS}: show it to both cameras in a few poses before each"
        )


def well_told(rig: StereoRig, mirrors: Mapping[str, Mirror], p_WQ: NDArray) -> dict[str, Mirror]:
    """Return the mirrors that are known well enough to find a body in them.

    Args:
        mirrors: With covariances.
        p_WQ: Places of the body [m]. Shape (N, 3).

    Raises:
        EstimationError: If they are too few for a shape.
    """
    found = {}
    for name, mirror in mirrors.items():
        assert mirror.covariance is not None, "a mirror that was learned has a covariance"
        slopes = reflected_projection(rig.cameras, mirror.values, p_WQ).by_mirror
        variance = np.einsum("nij,jk,nik->ni", slopes, mirror.covariance, slopes)
        if variance.max() < _VAGUE**2:
            found[name] = mirror
    _require_enough(found)
    return found


def look_at_shape(
    looks: MirrorLooks,
    mirrors: Mapping[str, Mirror],
    places: Mapping[str, NDArray],
    postures: Sequence[NDArray],
    stage: Stage | None = None,
) -> ShapeLooks:
    """Take a picture with both cameras before each mirror, the arm aside.

    Postures go by turns: one that leaves all of the chest before one mirror covers it in another.

    Args:
        looks: The robot before a mirror.
        mirrors: As the hand told them.
        places: Where their glasses really stand, X_BM. Shape (4, 4) each.
        postures: To look from, free of collisions [encoder units]. Shape (n,) each.
    """
    told = telling(stage, "looking at head and chest")
    shots, covered = [], []
    for k, (name, mirror) in enumerate(mirrors.items()):
        looks.before(mirror, places[name])
        clear = [one for one in postures if looks.clearance(one) > _CLEARANCE]
        clear = clear or [max(postures, key=looks.clearance)]
        shots.append(looks.shot(name, clear[k % len(clear)]))
        covered.append(looks.covered_at(shots[-1].readings))
        told(k + 1, len(mirrors))
    return ShapeLooks(
        MappingProxyType(dict(mirrors)), tuple(shots), tuple(covered), looks.room(), looks.noise
    )
