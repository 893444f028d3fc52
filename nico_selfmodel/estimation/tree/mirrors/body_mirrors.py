"""Mirrors that a known body sees itself in while its head moves: planes in its world.

The body is held as it was learned, but not taken for exact: see `estimation.tree.known`.
"""

from dataclasses import dataclass, replace

import numpy as np

from nico_selfmodel.blas_threads import on_one_blas_thread
from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.results.provenance import package_versions
from nico_selfmodel.estimation.tree.known.learned_anew import learn_anew
from nico_selfmodel.estimation.tree.mirrors.glass_flatness import flatness_of_glasses
from nico_selfmodel.estimation.tree.mirrors.mirrored_tree import names_of_mirrors, place_mirrors
from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
from nico_selfmodel.estimation.tree.tree_errors import errors_of, told_as
from nico_selfmodel.estimation.tree.tree_noise import noise_named
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import BodyTree


@dataclass(frozen=True, eq=False)
class BodyMirrors:
    """Mirrors learned by a body that is known."""

    found: TreeCalibration
    """The adjustment of the planes, the body held."""
    model: BodyModel
    """The body with the mirrors, and what is known of both together."""


@on_one_blas_thread
def calibrate_body_mirrors(
    data: BodyDataset,
    model: BodyModel,
    *,
    test: BodyDataset | None = None,
    name: str | None = None,
) -> BodyMirrors:
    """Learn the planes of all mirrors in which a body's cameras saw its markers.

    What was seen directly at the same poses tells where the joints were then. Noise is that of the
    body's training, where it tells.

    Args:
        data: The recording.
        model: The body.
        test: Held-out data, for judging only.
        name: Of the body with its mirrors; its own if omitted.

    Returns:
        The planes in the body's world, with standard deviations that count the body's own.

    Raises:
        DataError: If the recording is of another body, names no mirror, or a glass would be behind
            the cameras.
        ModelError: If the body has no cameras.
        NotIdentifiableError: If too little was seen in a mirror.
    """
    tree, told = _before_mirrors(data, model)
    seen, names = TreeObservations.of(told), names_of_mirrors(told.mirrors)
    parameters = TreeParameters(tree)
    parameters, values = place_mirrors(
        seen, parameters, parameters.values_of(tree), names, {}, seen.data.mirrors
    )
    learned = learn_anew(
        model,
        parameters.tree_of(values),
        told,
        names,
        noise=noise_named(model.noise, seen),
        name=name,
    )
    flat = flatness_of_glasses(learned.problem, learned.solution, learned.learned, learned.may_err)
    held_out = None if test is None else errors_of(learned.found.tree, test)
    found = replace(learned.found, flatness=flat, test=held_out)
    told_of = {**model.provenance, "mirrors": {"dataset": data.name, **package_versions("drake")}}
    return BodyMirrors(found, replace(learned.body(model, name), provenance=told_of))


def _before_mirrors(data: BodyDataset, model: BodyModel) -> tuple[BodyTree, BodyDataset]:
    """Return the body without the mirrors that are learned, and the recording in its markers."""
    if not model.tree.lenses:
        raise ModelError(
            f"body {model.name!r} has no cameras, so that it cannot look into a mirror: learn it "
            "from what cameras saw, with `nico-selfmodel calibrate body`"
        )
    if not data.mirrors:
        raise DataError(
            f"data set {data.name!r} has no reflection: the column `mirror` must name the mirror "
            "in rows whose pixels were seen in it"
        )
    others = tuple(mirror for mirror in model.tree.mirrors if mirror.name not in data.mirrors)
    tree, table = replace(model.tree, mirrors=others), data.observations
    direct = replace(data, observations=replace(table, mirror=np.full(len(table), "")))
    told = told_as(tree, direct)
    return tree, replace(told, observations=replace(told.observations, mirror=table.mirror))
