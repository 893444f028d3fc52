"""The best of several first bodies of a recording."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import ANY_POSE, BodyDataset
from nico_selfmodel.estimation.tree.boards.surroundings import Surroundings
from nico_selfmodel.estimation.tree.guesses.first_guess import first_bodies
from nico_selfmodel.estimation.tree.guesses.lens_guess import FACTORS
from nico_selfmodel.estimation.tree.guesses.touch_guess import Touches
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import seen_directly
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes
from nico_selfmodel.estimation.tree.tree_solution import TreeSolution
from nico_selfmodel.estimation.tree.tree_start import TreeStart
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.tree.body_tree import BodyTree

_AGREE = 1e-3
"""Difference of robust costs, a scalar, below which two starts reached one minimum."""
_PLENTY = 300
"""Samples in which each sensor saw each marker, and each joint had moved, on which first bodies are
tried: enough to tell one minimum from another."""
_HALF = 0.5
"""Share of the samples beyond which all are taken."""
_MOVED = 0.05
"""Share of its travel by which a joint has left where it mostly is."""


@dataclass(frozen=True, eq=False)
class FoundStart:
    """Where the search for a first body ended."""

    start: TreeStart
    """The best one, adjusted roughly."""
    tree: BodyTree
    """The first body that it comes from."""
    costs: tuple[float, ...]
    """Of all that were tried, a scalar."""
    begin: Callable[[str, BodyTree, Wishes], TreeStart]
    """Adjusts a first body roughly under some wishes."""
    observations: TreeObservations
    """What was measured."""

    @property
    def scalars(self) -> int:
        """How many numbers were measured."""
        return self.observations.scalars

    @cached_property
    def refined(self) -> tuple[TreeProblem, TreeSolution]:
        """The best one adjusted to the end, and its problem.

        Raises:
            ContradictedError: If every observation is an outlier.
            DataError: If there are fewer numbers than there are parameters.
        """
        return self.start.refined(self.observations)


def searched_start(
    data: BodyDataset,
    blank: BodyTree,
    description: Description | None,
    wishes: Wishes,
    seed: int,
    guessed: Collection[str] = (),
    most: int | None = None,
) -> FoundStart:
    """Try first bodies until two agree, on some of the samples where there are many.

    Args:
        blank: The body with nothing known of its geometry.
        description: The robot as described, where it is.
        guessed: Cameras whose lenses are hardly known.
        most: First bodies that are tried at most.

    Raises:
        DataError: If the recording cannot tell a first body, or nothing stands for the world.
        ValueError: If a name does not exist.
    """
    observations, few = TreeObservations.of(data), _few_samples(data, seed)
    tried = observations if few is data else TreeObservations.of(few)
    around = Surroundings.of_boards(tried, blank.lenses)
    best: tuple[TreeStart, BodyTree] | None = None
    costs: list[float] = []

    def begin(label: str, tree: BodyTree, wishes: Wishes) -> TreeStart:
        return TreeStart.from_body(label, tree, data, observations, description, wishes)

    for label, first in _bodies(few, blank, around, description, seed, guessed):
        tree = around.about(first)
        start = TreeStart.from_body(label, tree, few, tried, description, wishes)
        costs.append(start.cost / tried.scalars)
        if best is None or start.cost < best[0].cost:
            best = start, tree
        if agreeing(costs) >= 2 or len(costs) == most:
            break
    assert best is not None
    start, tree = best
    if few is not data:
        tree = start.parameters.tree_of(start.values)
        start = begin(start.label, tree, wishes)
    return FoundStart(start, tree, tuple(costs), begin, observations)


def _few_samples(data: BodyDataset, seed: int) -> BodyDataset:
    """Return enough samples to tell a body by, drawn at random; all where they are few."""
    table = data.observations
    first, rank = np.zeros(len(data.sample), dtype=bool), np.arange(len(data.sample))
    np.random.default_rng((seed, 7)).shuffle(rank)

    def take(samples: NDArray) -> None:
        first[samples[np.argsort(rank[samples])[:_PLENTY]]] = True

    key = np.where(table.pose == ANY_POSE, -1, table.sensor * len(data.markers) + table.marker)
    order = np.argsort(key, kind="stable")
    ends = np.flatnonzero(np.diff(key[order])) + 1
    for rows in np.split(order, ends):
        if key[rows[0]] >= 0:
            take(np.unique(table.pose[rows]))
    q = np.nan_to_num(data.si_readings)
    left = np.abs(q - np.median(q, axis=0)) > _MOVED * np.ptp(q, axis=0)
    for moved in left.T:
        take(np.flatnonzero(moved))
    return data if first.mean() > _HALF else data.select(first)


def _bodies(
    data: BodyDataset,
    blank: BodyTree,
    around: Surroundings,
    description: Description | None,
    seed: int,
    guessed: Collection[str],
) -> Iterable[tuple[str, BodyTree]]:
    """Yield labelled first bodies, with other focal lengths of lenses that are hardly known."""
    direct = seen_directly(data)
    if direct is None:
        return [("boards", around.alone(blank))]
    seen = TreeObservations.of(direct, ~Touches.of(direct).rows)
    return chain.from_iterable(
        first_bodies(
            direct,
            replace(blank, lenses=some),
            seen,
            description and replace(description, tree=replace(description.tree, lenses=some)),
            around.cameras,
            seed,
        )
        for some in _lens_tries(blank.lenses, guessed)
    )


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


def agreeing(costs: Sequence[float]) -> int:
    """Return how many starts reached the best minimum, by their costs a scalar."""
    least = min(costs)
    return sum(bool(cost - least < _AGREE) for cost in costs)
