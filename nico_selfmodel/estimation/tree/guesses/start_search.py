"""The best of several first bodies of a recording."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.estimation.tree.boards.surroundings import Surroundings
from nico_selfmodel.estimation.tree.guesses.first_guess import first_bodies
from nico_selfmodel.estimation.tree.guesses.lens_guess import FACTORS
from nico_selfmodel.estimation.tree.guesses.touch_guess import Touches
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import seen_directly
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes
from nico_selfmodel.estimation.tree.tree_start import TreeStart
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import BodyTree

_AGREE = 1e-3
"""Difference of robust costs, a scalar, below which two starts reached one minimum."""


@dataclass(frozen=True, eq=False)
class FoundStart:
    """Where the search for a first body ended."""

    start: TreeStart
    """The best one, adjusted roughly."""
    tree: BodyTree
    """The first body that it comes from."""
    costs: tuple[float, ...]
    """Of all that were tried."""
    scalars: int
    """How many numbers were measured."""
    begin: Callable[[str, BodyTree, Wishes], TreeStart]
    """Adjusts a first body roughly under some wishes."""


def searched_start(
    data: BodyDataset,
    blank: BodyTree,
    description: Description | None,
    wishes: Wishes,
    seed: int,
    guessed: Collection[str] = (),
) -> FoundStart:
    """Try first bodies until two agree.

    Args:
        data: The recording.
        blank: The body with nothing known of its geometry.
        description: The robot as described, where it is.
        wishes: What the user holds, frees or knows.
        seed: Of what is drawn.
        guessed: Cameras whose lenses are hardly known.

    Raises:
        DataError: If the recording cannot tell a first body, or nothing stands for the world.
        ValueError: If a name does not exist.
    """
    observations, direct = TreeObservations.of(data), seen_directly(data)
    around = Surroundings.of_boards(observations, blank.lenses)
    best: tuple[TreeStart, BodyTree] | None = None
    costs: list[float] = []

    def begin(label: str, tree: BodyTree, wishes: Wishes) -> TreeStart:
        return TreeStart.from_body(label, tree, data, observations, description, wishes)

    bodies: Iterable[tuple[str, BodyTree]] = [("boards", around.alone(blank))]
    if direct is not None:
        seen = TreeObservations.of(direct, ~Touches.of(direct).rows)
        lenses = _lens_tries(blank.lenses, guessed)
        bodies = chain.from_iterable(
            first_bodies(
                direct,
                replace(blank, lenses=some),
                seen,
                description and replace(description, tree=replace(description.tree, lenses=some)),
                around.cameras,
                seed,
            )
            for some in lenses
        )
    for label, tree in bodies:
        tree = around.about(tree)
        start = begin(label, tree, wishes)
        costs.append(start.cost)
        if best is None or start.cost < best[0].cost:
            best = start, tree
        if agreeing(costs, observations.scalars) >= 2:
            break
    assert best is not None
    return FoundStart(*best, tuple(costs), observations.scalars, begin)


def _lens_tries(
    lenses: Mapping[str, Camera], guessed: Collection[str]
) -> Iterator[dict[str, Camera]]:
    """Yield lenses with other focal lengths of those that are hardly known."""
    for factor in FACTORS if guessed else (1.0,):
        tried = {
            name: replace(lenses[name], fx=factor * lenses[name].fx, fy=factor * lenses[name].fy)
            for name in guessed
        }
        yield {**lenses, **tried}


def agreeing(costs: Sequence[float], scalars: int) -> int:
    """Return how many starts reached the best minimum.

    Args:
        costs: Of the starts.
        scalars: How many numbers were measured.
    """
    least = min(costs)
    return sum(bool(cost - least < _AGREE * scalars) for cost in costs)
