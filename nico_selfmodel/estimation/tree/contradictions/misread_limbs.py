"""Limbs that no body explains: their readings are exchanged, jump or are late; mended, they fit."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.link_joint import WORLD_NAME
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.diagnosis.fault_hypotheses import Causes, causes_of_misfit
from nico_selfmodel.estimation.diagnosis.suspected_readings import (
    TURNED_ABOUT,
    LateReadings,
    Suspicion,
    lagging,
)
from nico_selfmodel.estimation.initialization.axis_search import random_starts
from nico_selfmodel.estimation.initialization.start_search import (
    ASTRAY,
    ENOUGH_AGREE,
    RANDOM,
    few_rows,
    search_starts,
)
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import errors_by_link
from nico_selfmodel.estimation.tree.contradictions.standing_still import still_readings
from nico_selfmodel.estimation.tree.guesses.carried_cameras import reconstructed_by
from nico_selfmodel.estimation.tree.guesses.point_guess import (
    POINT_SIGMA,
    SeenPoints,
    limb_observations,
)
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WORLD, BodyTree

_LIMB_STARTS = 10
"""Random starts of a limb of which all is asked anew."""
_MOST_PAIRS = 24
"""Pairs of joints of two limbs that are asked, those that are as far from the world first."""


def refuse_misread_limbs(found: FoundStart, data: BodyDataset, seed: int) -> None:
    """Refuse readings that no body explains and one limb does, once they are mended.

    Each limb of joints that turn is asked, those first that fit worst, by its points in space as an
    arm alone is: whether two of its joints are read for each other, its readings jump by a turn, or
    are of another sample. One of its joints may be read for another limb's, and its own joints, or
    those it shares, be late.

    Args:
        found: The first body.
        data: The recording.
        seed: Of the starts of limbs.

    Raises:
        DataError: If there is such a limb; it says what would mend it, and others that are late.
    """
    points, late, left = _in_space(found, data), list[LateReadings](), ""
    if points is None:
        return
    missed = errors_by_link(found, data)
    links = sorted({found.tree.markers[m].on for m in points.marker.tolist()})
    for link in sorted(links, key=lambda link: -missed.get(link, 0.0)):
        joints = np.flatnonzero(found.tree.beyond[link]).tolist() if link != WORLD else []
        if not joints or any(_is_no_arms(data, i) for i in joints):
            continue
        causes = _causes_in_limb(data, found.tree, points, link, joints, seed)
        if causes.late is not None:
            own = causes.late.joints or tuple(data.joints[i].name for i in joints)
            late.append(replace(causes.late, joints=own))
            left = left or causes.left
        elif causes.words and not late:
            cause = f"{causes.words[0]}{_or_inverted(data, causes.words[0])}"
            raise DataError(f"no body explains data set {data.name!r}: {cause}")
    if late:
        raise DataError(f"no body explains data set {data.name!r}: {_of_all(late, data)}; {left}")


def _or_inverted(data: BodyDataset, cause: str) -> str:
    """Say that poses told the other way round fit as an arm does whose joints are turned about."""
    told = [s.name for s in data.sensors if (s.kind, s.on) == (POSES, WORLD_NAME)]
    if not (told and cause.startswith(TURNED_ABOUT)):
        return ""
    return f", or invert what {told[0]!r} tells, if these are its own poses in a marker's frame"


def _of_all(late: list[LateReadings], data: BodyDataset) -> LateReadings:
    """Return which joints are late as the first limb's are."""
    alike = {name for one in late if one.shift == late[0].shift for name in one.joints}
    names = tuple(name for name in data.joint_names if name in alike)
    return replace(late[0], joints=() if len(names) == len(data.joints) else names)


def _is_no_arms(data: BodyDataset, i: int) -> bool:
    return data.joints[i].motion != REVOLUTE or bool(data.joints[i].follows)


def _causes_in_limb(
    data: BodyDataset, tree: BodyTree, points: SeenPoints, link: int, joints: list[int], seed: int
) -> Causes:
    """Return what would make one limb fit, where it does not."""
    carried = [m for m, marker in enumerate(tree.markers) if marker.on == link]
    local = points.of_markers(np.array(carried))
    observations = limb_observations(data, tree, joints, np.unique(local.marker), local)
    known = np.array([data.joints[i].gear_known for i in joints])
    zero = np.where(known, 0.0, np.median(observations.angles, axis=0))
    few = few_rows(observations, seed)
    astray, rng = ASTRAY * few.size, np.random.default_rng(seed)
    drawn = islice(random_starts(few, known, zero, rng, worst=astray), _LIMB_STARTS)
    starts = ((RANDOM, arm) for arm in drawn)
    search = search_starts(observations, few, starts, known, POINT_SIGMA, "cauchy", astray)
    # That few starts agree is no contradiction.
    search = replace(search, agreeing=max(search.agreeing, ENOUGH_AGREE))
    asked = (observations, search, known, known, zero, POINT_SIGMA, "cauchy")
    beside = [*_late_alone(tree, observations, joints, known)]
    beside += _exchanged_across(data, tree, few_rows(observations, 0), joints, known)
    return causes_of_misfit(*asked, scatter=0.0, beside=beside)


def _late_alone(
    tree: BodyTree, limb: Observations, joints: list[int], known: NDArray
) -> Iterator[Suspicion]:
    """Yield readings of a limb's own joints that are late, or of those that it shares."""
    last, moved = joints[-1], tree.beyond[:-1]
    related = moved[last] | moved[:, last]
    own = [k for k, i in enumerate(joints) if related[moved[:, i]].all()]
    shared = [k for k in range(len(joints)) if k not in own]
    if own and shared:
        yield from lagging(limb, known, (-1, 1), own)
        yield from lagging(limb, known, (-1, 1), shared)


def _exchanged_across(
    data: BodyDataset, tree: BodyTree, few: Observations, joints: list[int], known: NDArray
) -> list[Suspicion]:
    """Return readings of one joint of a limb exchanged with those of one that does not move it."""
    rows = dict(zip(data.sample.tolist(), data.si_readings, strict=True))
    read = np.array([rows[sample] for sample in few.sample.tolist()])
    still, depth = still_readings(data), tree.beyond.sum(axis=1)
    others = [
        j
        for j, joint in enumerate(data.joints)
        if j not in joints and not _is_no_arms(data, j) and joint.name not in still
    ]
    pairs = [(k, i, j) for k, i in enumerate(joints) for j in others]
    pairs.sort(key=lambda pair: abs(depth[pair[1]] - depth[pair[2]]))
    found = []
    for k, i, j in pairs[:_MOST_PAIRS]:
        angles, pinned = few.angles.copy(), known.copy()
        angles[:, k], pinned[k] = read[:, j], data.joints[j].gear_known
        first, second = data.joints[min(i, j)].name, data.joints[max(i, j)].name
        words = f"the readings of {first} and {second} are exchanged"
        found.append(Suspicion(words, replace(few, angles=angles), pinned))
    return found


def _in_space(found: FoundStart, data: BodyDataset) -> SeenPoints | None:
    """Return markers as what stands in the world located them, whatever joints were read to."""
    seen = found.observations
    standing = [rows for rows in seen.sensors if data.sensors[rows.sensor].on == WORLD_NAME]
    trackers = [rows for rows in standing if rows.kind in (POINTS, POSES)]
    cameras = [rows for rows in standing if rows.kind == CAMERA and not rows.mirror]
    if trackers:
        first = trackers[0]
        return SeenPoints(first.pose, first.marker, first.measured[:, :3])
    if len(cameras) < 2:
        return None
    places = {sensor.name: sensor.X_LA for sensor in found.tree.sensors}
    return reconstructed_by(data, found.tree, cameras, places)
