"""A body before mirrors: direct sights tell a first body, and that where the mirrors are."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.guesses.mirror_guess import mirrors_in
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.estimation.tree.tree_problem import TreeProblem
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.tree.body_tree import BodyTree
from nico_selfmodel.model.tree.standing_mirror import StandingMirror
from nico_selfmodel.names import listed


def seen_directly(data: BodyDataset) -> BodyDataset | None:
    """Return a recording without reflections, and without what moves freely.

    A first body is found from it; None where only what moves freely was seen.

    Raises:
        DataError: If nothing else is left, or something was seen in mirrors alone.
    """
    if data.free_joints:
        rest = ~np.isin(data.seen_on, data.free_joints)
        if not rest.any():
            return None
        data = data.of_rows(rest)
    table = data.observations
    direct = table.mirror == ""
    if direct.all():
        return data
    if not direct.any():
        raise DataError(
            f"all of data set {data.name!r} was seen in mirrors: a body is learned from what is "
            "seen directly; `calibrate mirror` learns the mirrors of a body that is known"
        )
    for items, column in ((data.markers, table.marker), (data.sensors, table.sensor)):
        alone = set(column[~direct].tolist()) - set(column[direct].tolist())
        if alone:
            names = sorted(items[i].name for i in alone)
            raise DataError(
                f"{listed(names)} of data set {data.name!r} took part in reflections alone: only "
                "what is seen directly, too, tells a first body"
            )
    return data.of_rows(direct)


def anywhere(mirrors: Iterable[str]) -> tuple[StandingMirror, ...]:
    """Return mirrors that nobody has found yet, to name their parameters."""
    return tuple(StandingMirror(name, Plane(np.eye(3)[0], 0.0)) for name in mirrors)


def apart_from(tree: BodyTree, mirrors: Iterable[str]) -> tuple[str, ...]:
    """Return those of some mirrors that a body does not know."""
    known = {mirror.name for mirror in tree.mirrors}
    return tuple(name for name in mirrors if name not in known)


def names_of_mirrors(mirrors: Iterable[str]) -> frozenset[str]:
    """Return the names of the parameters of mirrors."""
    return frozenset(name for mirror in mirrors for name in Mirror.names_of(mirror))


def place_mirrors(
    seen: TreeObservations,
    parameters: TreeParameters,
    values: NDArray,
    free: frozenset[str],
    fixed: Mapping[str, float],
    mirrors: tuple[str, ...],
) -> tuple[TreeParameters, NDArray]:
    """Place mirrors of a recording about a body that is nearly known, everything else held.

    Args:
        parameters: Of the body, its mirrors anywhere.
        values: Of its parameters. Shape (P,).
        fixed: Values at which the user holds some.

    Returns:
        Parameters whose mirrors' tilts are told from where they are, and the values.

    Raises:
        DataError: If a mirror would be behind the cameras.
        NotIdentifiableError: If too little was seen in one.
    """
    tree = parameters.tree_of(values)
    tree = tree.with_mirrors(mirrors_in(seen.data, tree, mirrors))
    parameters = TreeParameters(replace(parameters.base, mirrors=tree.mirrors))
    values, planes = parameters.values_of(tree), names_of_mirrors(mirrors)
    for name in planes & set(fixed):
        values[parameters.index[name]] = fixed[name]
    problem = TreeProblem(TreeResiduals(seen, parameters), planes & free, {})
    return parameters, problem.rough(values)[0]
