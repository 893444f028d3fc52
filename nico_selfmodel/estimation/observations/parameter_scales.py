"""Scales on which the sigma of a parameter says whether it is known at all."""

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.model.self_model import SelfModel


def parameter_scales_of(model: SelfModel, names: tuple[str, ...]) -> NDArray:
    """Return the parameter scale of each parameter: one radian, the arm's length, the gear.

    Args:
        names: Parameters of its arm, or of the pose of a camera.

    Returns:
        Shape (k,).
    """
    arm = model.parameters
    known = dict(zip(arm.names, arm.scales(arm_size(model)).tolist(), strict=True))
    poses = {"rx": 1.0, "ry": 1.0, "rz": 1.0}
    size = arm_size(model)
    return np.array([known.get(name, poses.get(name.rpartition(".")[2], size)) for name in names])


def arm_size(model: SelfModel) -> float:
    """Return about how long the arm is: from the hand to the furthest axis' point [m]."""
    chain = model.chain
    return float(np.linalg.norm(chain.p_WH_zero[0] - chain.points, axis=1).max())
