"""Where the zeros of a body's encoders may be when they are not near the old ones.

Each lost zero is held against the observations all over the turn, joint by joint from the root, the
others where they fit best so far. See `zero_search` for an arm, whose zeros are tried together.
"""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.tree.forward.tree_residuals import TreeResiduals
from nico_selfmodel.estimation.tree.tree_observations import TreeObservations
from nico_selfmodel.estimation.tree.tree_parameters import TreeParameters
from nico_selfmodel.model.tree.body_tree import BodyTree

_ANGLES = np.radians(np.arange(-180.0, 180.0, 3.0))
"""Zeros of a joint that turns which are tried."""
_SWEEPS = 3
"""Over all joints."""
_CLOSE = 0.1
"""Errors count as close below this share of the typical one."""


def likely_zeros(tree: BodyTree, seen: TreeObservations, names: frozenset[str]) -> BodyTree:
    """Return a body whose zeros explain observations better than others all over the turn do.

    Args:
        tree: The body; all but `names` is near the truth.
        seen: What was seen of it.
        names: Zeros that are lost, parameters of joints' frames; of joints that turn they are
            searched.
    """
    parameters = TreeParameters(tree)
    residuals = TreeResiduals(seen, parameters)
    values = parameters.values_of(tree)
    turned = [i for i, name in enumerate(parameters.names) if name in names and name[-2:] == "rz"]
    close = _CLOSE * float(np.nanmedian(_errors(residuals, values)))

    def score(values: NDArray) -> float:
        # Cauchy: a few observations that fit say more than many that nearly do.
        errors = np.nan_to_num(_errors(residuals, values) / close, nan=1e6, posinf=1e6)
        return float(np.sum(np.log1p(errors**2)))

    for _ in range(_SWEEPS):
        before = values.copy()
        for column in turned:
            trials = np.tile(values, (len(_ANGLES) + 1, 1))
            trials[1:, column] = _ANGLES
            values = trials[int(np.argmin([score(trial) for trial in trials]))]
        if np.array_equal(values, before):
            break
    return parameters.tree_of(values)


def _errors(residuals: TreeResiduals, values: NDArray) -> NDArray:
    """Return by how much each observation is missed, in its sensor's sigmas. Shape (N,)."""
    seen = residuals.observations
    r = residuals.residuals(values) / seen.stated_sigma[seen.noise_group]
    return np.sqrt(seen.per_row(r * r))
