"""Values and priors that the user told and the data contradict: found before noise hides them."""

from collections.abc import Callable, Collection
from dataclasses import replace

from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.tree_setup import Wishes
from nico_selfmodel.estimation.tree.tree_start import TreeStart
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.names import listed

_LEAST = 30.0
"""Fall of twice the robust cost that is no accident: chi square of one, one in 10^7."""
_SHARE = 0.1
"""And of that by number that was measured: residuals that are a twentieth larger."""

Begin = Callable[[str, BodyTree, Wishes], TreeStart]
"""A first body, adjusted roughly under some wishes."""


def agreeing_start(
    start: TreeStart, tree: BodyTree, wishes: Wishes, scalars: int, begin: Begin
) -> TreeStart:
    """Return a start that keeps what the user told; refuse what the data contradict.

    Let go, values that are right lower the cost by about chi square of their number. A start that
    they only led astray is begun again where they are not told.

    Args:
        start: The best one.
        tree: The first body that it comes from.
        wishes: What the user told.
        scalars: How many numbers were measured.
        begin: Adjusts a first body.

    Raises:
        DataError: If the data contradict a value or a prior; it names them and says where they
            would go.
    """
    told = sorted({n for n, v in wishes.pins.pinned.items() if v is not None} | set(wishes.priors))
    if not told:
        return start
    limit = max(_LEAST, _SHARE * scalars)
    loose = begin(start.label, tree, _without(wishes, told))
    if start.cost < loose.cost + limit:
        return start
    body = loose.parameters.tree_of(loose.values)
    start = min(start, begin(start.label, body, wishes), key=lambda one: one.cost)
    wrong: list[str] = []
    now = start
    while now.cost > loose.cost + limit and len(wrong) < len(told):
        others = [name for name in told if name not in wrong]
        tries = [begin(start.label, body, _without(wishes, [*wrong, n])) for n in others]
        best = min(range(len(tries)), key=lambda i: tries[i].cost)
        now = tries[best]
        wrong.append(others[best])
    if wrong:
        raise DataError(_words(wrong, wishes, now))
    return start


def _without(wishes: Wishes, names: Collection[str]) -> Wishes:
    """Return the wishes without what they say of some parameters, which are then estimated."""
    pinned = {n: v for n, v in wishes.pins.pinned.items() if n not in names}
    freed = wishes.pins.freed | frozenset(names)
    priors = {n: p for n, p in wishes.priors.items() if n not in names}
    pins = replace(wishes.pins, pinned=pinned, freed=freed)
    return replace(wishes, pins=pins, priors=priors)


def _words(wrong: list[str], wishes: Wishes, freed: TreeStart) -> str:
    wanted = dict(zip(freed.parameters.names, freed.values.tolist(), strict=True))
    units = dict(zip(freed.parameters.names, freed.parameters.units, strict=True))
    said, options = [], []
    for name in wrong:
        known = wishes.priors.get(name)
        value = wishes.pins.pinned.get(name)
        is_told = f"fixed at {value:g}" if known is None else f"said to be {known[0]:g}"
        unit = "" if units[name] == "1" else f" {units[name]}"
        said.append(f"{name} is {is_told}{unit}, the data ask for {wanted[name]:.3g}")
        if name in wishes.by_poses:
            options.append(
                f"the known `pose` of {name.rpartition('.')[0]} (of --cameras, if given)"
            )
        else:
            options.append(f"--{'fix' if known is None else 'prior'} {name}")
    options = list(dict.fromkeys(options))
    return (
        f"{'; '.join(said)}: they contradict each other; correct what was told, or leave out "
        f"{listed(options)}"
    )
