"""Joints read in another unit than stated, the other way, for another or late: mended, they fit."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, SelfModelError
from nico_selfmodel.estimation.diagnosis.mistaken_units import OTHER_UNIT, mistaken_units
from nico_selfmodel.estimation.tree.contradictions.against_the_rest import (
    FEW_STARTS,
    Search,
    largest_error,
    some_samples,
)
from nico_selfmodel.estimation.tree.contradictions.misread_limbs import refuse_misread_limbs
from nico_selfmodel.estimation.tree.contradictions.standing_still import still_readings
from nico_selfmodel.estimation.tree.guesses.start_search import FoundStart
from nico_selfmodel.estimation.tree.guesses.told_turns import refuse_other_turns
from nico_selfmodel.estimation.tree.timing.late_sensors import explained_by_lag
from nico_selfmodel.model.tree.body_tree import REVOLUTE, WHOLE_POSES
from nico_selfmodel.names import listed

_SMALLER = 2.0
"""Times that errors are smaller with a unit that is mended, at least."""
_POOR = 4.0
"""Robust cost a scalar of a first body from which on errors are several times a sensor's."""
_LIMB_POOR = 0.005
"""Usual error of a limb over what its sensor's sights spread from which on it is asked, however
sound others are: joints of 0.5 deg of noise leave 0.004 to 0.005, two that are exchanged 0.007."""


def start_as_it_was_read(
    data: BodyDataset, moving: NDArray, search: Search, seed: int = 0, *, described: bool = False
) -> FoundStart:
    """Return a first body; refuse readings that fit mended, and as they were read do not.

    Spans of the joints tell which units are in doubt. They are wrong where a body learned anew
    from the mended readings leaves errors that are far smaller. That of one joint spoils all.

    Args:
        data: The recording.
        moving: Which joints move anything that was seen. Boolean, shape (n,).
        search: Finds a first body.
        seed: Of the starts of single limbs.
        described: Whether a description tells which way joints turn.

    Raises:
        DataError: If there are such joints; it names them and their unit. If turns of a sensor
            were taken for others than they are.
    """
    found = _in_stated_units(data, moving, search)
    poor = found.start.cost > _POOR * found.scalars
    if (poor or largest_error(found, data) > _LIMB_POOR) and not explained_by_lag(found):
        refuse_other_turns(found, data)
        refuse_misread_limbs(found, data, seed)
        if poor and described:
            _refuse_reversed(data, moving, search, seed)
    return found


def _refuse_reversed(data: BodyDataset, moving: NDArray, search: Search, seed: int) -> None:
    """Refuse readings of a joint that fit far better with their sign changed, by some samples."""
    few, still = some_samples(data, seed), still_readings(data)
    better, stated = [], _tried(few, search, FEW_STARTS)
    for i in np.flatnonzero(moving).tolist():
        joint = data.joints[i]
        if joint.motion in WHOLE_POSES or joint.follows or joint.name in still:
            continue
        factors = np.ones(len(data.joints))
        factors[i] = -1.0
        mended = _tried(_times(few, factors), search, FEW_STARTS)
        if isinstance(mended, FoundStart) and _is_better(mended, stated):
            better.append((mended.start.cost, joint.name))
    if better:
        raise DataError(
            f"{min(better)[1]!r} moves the other way than described: with its readings negated the "
            f"same observations fit; say `sign: -1` of it in data set {data.name!r}, or turn its "
            "axis in the robot's description"
        )


def _in_stated_units(data: BodyDataset, moving: NDArray, search: Search) -> FoundStart:
    """Return a first body; refuse readings that fit in another unit than stated."""
    factors = _in_doubt(data, moving)
    if (factors == 1.0).all():
        return search(data, None)
    stated = _tried(data, search)
    mended = _tried(_times(data, factors), search)
    if isinstance(mended, SelfModelError) or not _is_better(mended, stated):
        if isinstance(stated, SelfModelError):
            raise stated
        return stated
    wrong = np.flatnonzero(factors != 1.0).tolist()
    if 1 < len(wrong) < len(factors):
        wrong = [i for i in wrong if _is_needed(i, data, factors, mended, search)]
    raise DataError(_words(data, wrong))


def _in_doubt(data: BodyDataset, moving: NDArray) -> NDArray:
    """Return what would mend each joint's readings, 1 where nothing. Shape (n,)."""
    joints, factors = data.joints, np.ones(len(data.joints))
    turning = [i for i, j in enumerate(joints) if j.motion == REVOLUTE and not j.follows]
    units = [joints[i].encoder_unit for i in turning]
    asked = np.asarray(moving)[turning]
    if turning:
        factors[turning] = mistaken_units(data.si_readings[:, turning], units, asked)
    return factors


def _times(data: BodyDataset, factors: NDArray) -> BodyDataset:
    return replace(data, readings=data.readings * factors)


def _tried(
    data: BodyDataset, search: Search, most: int | None = None
) -> FoundStart | SelfModelError:
    """Return a first body, of so many at most if that is told, or why there is none."""
    try:
        return search(data, most)
    except SelfModelError as error:
        return error


def _is_better(mended: FoundStart, stated: FoundStart | SelfModelError) -> bool:
    """Whether errors are far smaller; costs hold twice their logarithms."""
    if isinstance(stated, SelfModelError):
        return True
    limit = 2.0 * mended.scalars * np.log(_SMALLER)
    return stated.start.cost - mended.start.cost > limit


def _is_needed(
    i: int, data: BodyDataset, factors: NDArray, mended: FoundStart, search: Search
) -> bool:
    """Whether the others mended alone do not fit."""
    others = factors.copy()
    others[i] = 1.0
    return _is_better(mended, _tried(_times(data, others), search))


def _words(data: BodyDataset, wrong: list[int]) -> str:
    joints = [data.joints[i] for i in wrong]
    names = {unit: [j.name for j in joints if j.encoder_unit == unit] for unit in OTHER_UNIT}
    said = [
        f"{listed(found)} {'is' if len(found) == 1 else 'are'} read in {OTHER_UNIT[unit][0]}, not "
        f"in {unit} as data set {data.name!r} states (encoder_unit)"
        for unit, found in names.items()
        if found
    ]
    return f"{'; '.join(said)}: with readings so mended the same observations fit"
