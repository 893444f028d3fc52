"""What a mark is found to be, and where; each mark once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.mirrors.mark_place import GATE_3, ON_ME, LinkPlace, Spot


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


def on_me(place: LinkPlace, spots: tuple[Spot, ...]) -> Finding:
    """Return a mark on the own body.

    Args:
        place: Where.
        spots: What it was seen as.
    """
    return Finding(ON_ME, place.link, place.p_FM, place.own + place.common, spots)


def told_once(found: Sequence[Finding]) -> list[Finding]:
    """Return marks on the own body without those whose middle another has, the best known of each.

    Of what shows in part, as directly past an outline and whole in the mirror, the parts lie apart
    until each has the middle of the disc of which it is.
    """
    kept: list[Finding] = []
    for one in found:
        same = next((k for k, other in enumerate(kept) if _of_one(other, one)), None)
        if same is None:
            kept.append(one)
        else:
            better = min(kept[same], one, key=_variance)
            kept[same] = replace(better, spots=kept[same].spots + one.spots)
    return kept


def _of_one(a: Finding, b: Finding) -> bool:
    """Return whether two marks on one link lie no farther apart than they are known."""
    assert a.p_FM is not None
    assert b.p_FM is not None
    off = a.p_FM - b.p_FM
    return a.link == b.link and float(off @ off) < GATE_3 * (_variance(a) + _variance(b))


def _variance(found: Finding) -> float:
    """Return that of a place along its surface, mean of both ways [m^2]."""
    assert found.covariance is not None
    return 0.5 * float(np.trace(found.covariance))
