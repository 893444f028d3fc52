"""Which parameters too few poses leave open, by name."""

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.body.body_initialization import lines_of, named_like
from nico_selfmodel.estimation.body.body_problem import FIRST_CORNER_SIGMA, BodySolution
from nico_selfmodel.estimation.body.body_uncertainty import whitened_rows
from nico_selfmodel.estimation.cameras.camera_initialization import pose_of_seen_boards
from nico_selfmodel.estimation.noise.hand_noise import HandNoise
from nico_selfmodel.estimation.observations.observations import gears_known
from nico_selfmodel.estimation.observations.parameter_scales import arm_size
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.optimization.uncertainty import Uncertainty


def open_at(
    start: SelfModel,
    observations: PixelObservations,
    free: frozenset[str],
    boards: BoardViews | None,
    noise: HandNoise,
) -> tuple[str, ...]:
    """Return which free parameters cannot be observed, wholly or in part, at a body that is known.

    Args:
        start: Arm and cameras, the left one at the world.
        observations: What was seen.
        free: Parameters that would be estimated.
        boards: Corners in the same problem, if any.
        noise: What disturbs the hand's pixels.

    Returns:
        Names, those that the data tell least of first; empty where the data tell all.
    """
    rig, nobody = start.rig, np.zeros(len(observations), dtype=bool)
    gear_known = gears_known(observations.arm.units)
    parameters = named_like(lines_of(start, observations.arm.markers), start, gear_known)
    X_LG = None if boards is None else pose_of_seen_boards(rig.cameras, boards)
    solution = BodySolution(
        np.zeros(0), rig, noise, FIRST_CORNER_SIGMA, X_LG, nobody, True, 0, history=()
    )
    size = arm_size(start)
    rows = whitened_rows(observations, parameters, solution, free, boards, True, size)
    # The variances are given: nothing is scaled by how the start misses what was seen.
    found = Uncertainty.from_jacobian(rows.names, rows.jacobian, rows.scales, 0.0, 0)
    share = dict.fromkeys(found.names, 0.0)
    for direction in found.unobservable:
        for name, part in zip(direction.names, direction.shares.tolist(), strict=True):
            share[name] += part**2
    unknown = np.array(found.names)[~np.isfinite(found.sigma)].tolist()
    return tuple(sorted(unknown, key=lambda name: -share[name]))
