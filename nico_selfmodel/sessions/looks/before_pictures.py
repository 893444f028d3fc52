"""How well mirrors, body and cameras are known before the body was seen in the mirrors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.noise.hand_observations import covariance_of
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.self_model import SelfModel

_JOINT_SIGMA = np.radians(1.5)
"""How far they may stand from where the description holds them [rad]."""
_TURN_SIGMA, _SHIFT_SIGMA = np.radians(0.7), 2e-3
"""How far the body may stand from where the learned arm has it, about the shoulder [rad, m]."""


def before_pictures(model: SelfModel, mirrors: Sequence[str], joints: int) -> NDArray:
    """Return the covariance of mirrors, standing joints and the whole body.

    Args:
        model: Who has learned the mirrors: from one arm, so that they err together where the
            model's covariance says so.
        mirrors: m of them.
        joints: k that nobody commands.

    Returns:
        Of the mirrors' values, the joints' angles, and the body's turn and shift. Shape
        (3 m + k + 6, 3 m + k + 6).
    """
    planes = 3 * len(mirrors)
    sigma = [_JOINT_SIGMA] * joints + [_TURN_SIGMA] * 3 + [_SHIFT_SIGMA] * 3
    covariance = np.diag(np.square([0.0] * planes + sigma))
    covariance[:planes, :planes] = _of_mirrors(model, mirrors)
    return covariance


def with_cameras(
    model: SelfModel, mirrors: Sequence[str], own: NDArray
) -> tuple[tuple[str, ...], NDArray]:
    """Return the covariance with what the cameras may be wrong by, as the mirrors are with them.

    Args:
        model: Who has learned cameras and mirrors.
        own: Of `before_pictures`. Shape (n, n).

    Returns:
        Names of what may be wrong of the cameras, c of them, and the covariance. Shape (n + c,
        n + c).
    """
    cameras = loose_cameras(model)
    together = covariance_of(model, (*_names_of(mirrors), *cameras))
    n, planes = len(own), 3 * len(mirrors)
    matrix = np.zeros((n + len(cameras),) * 2)
    matrix[:n, :n], matrix[n:, n:] = own, together[planes:, planes:]
    matrix[n:, :planes] = together[planes:, :planes]
    matrix[:planes, n:] = together[:planes, planes:]
    return cameras, matrix


def loose_cameras(model: SelfModel) -> tuple[str, ...]:
    """Return the names of what may be wrong of the cameras."""
    names = model.rig.names
    loose = np.diag(covariance_of(model, names)) > 0.0
    return tuple(name for name, free in zip(names, loose, strict=True) if free)


def mirrors_and_cameras(
    model: SelfModel, mirrors: Sequence[str]
) -> tuple[tuple[str, ...], NDArray]:
    """Return how mirrors and cameras err together, as the hand told them.

    Args:
        model: Who has learned them.
        mirrors: Which; m of them.

    Returns:
        Names of what may be wrong of the cameras, c of them, and the covariance of the mirrors'
        values and these. Shape (3 m + c, 3 m + c).
    """
    return with_cameras(model, mirrors, _of_mirrors(model, mirrors))


def _of_mirrors(model: SelfModel, mirrors: Sequence[str]) -> NDArray:
    """Return the covariance of mirrors, together where the model says so. Shape (3 m, 3 m)."""
    names = _names_of(mirrors)
    if model.covariance is not None and set(names) <= set(model.covariance.names):
        return covariance_of(model, names)
    matrix = np.zeros((len(names), len(names)))
    for k, name in enumerate(mirrors):
        block = model.mirrors[name].covariance
        assert block is not None, "a mirror that was learned has a covariance"
        matrix[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = block
    return matrix


def _names_of(mirrors: Sequence[str]) -> tuple[str, ...]:
    return tuple(name for mirror in mirrors for name in Mirror.names_of(mirror))
