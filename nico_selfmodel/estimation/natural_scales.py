"""Scales on which the sigma of a parameter says whether it is known at all."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.self_model import SelfModel


def natural_scales_of(model: SelfModel, names: tuple[str, ...]) -> NDArray:
    """Return the natural scale of each parameter: one radian, the arm's length, the gear.

    Args:
        model: The body.
        names: Parameters of its arm, or of the pose of an eye.

    Returns:
        Shape (k,).
    """
    gears = dict(zip(model.joints, model.servos.gear.tolist(), strict=True))
    size, scales = arm_size(model), []
    for name in names:
        joint, _, part = name.rpartition(".")
        if part == "gear":
            scales.append(gears[joint])
        else:
            scales.append(1.0 if part in ("theta_offset", "rx", "ry", "rz", "alpha") else size)
    return np.array(scales)


def arm_size(model: SelfModel) -> float:
    """Return about how long the arm is: from the hand to the furthest axis' point [m]."""
    chain = model.chain
    return float(np.linalg.norm(chain.p_WH_zero[0] - chain.points, axis=1).max())
