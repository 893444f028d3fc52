"""What learning anew changed in a self-model: every number before and after, beside its sigma."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from nico_selfmodel.geometry.angles import nearest_rotation_vector, nearest_turn
from nico_selfmodel.model.arm.dh_parameters import M0_NAMES
from nico_selfmodel.model.arm.link_lengths import link_lengths
from nico_selfmodel.model.cameras.rig_parameters import POSE_NAMES, rig_names, rig_units, rig_values
from nico_selfmodel.model.self_model import SelfModel


def parameter_changes(
    before: SelfModel, after: SelfModel, names: Iterable[str]
) -> dict[str, dict[str, Any]]:
    """Hold parameters of a model against what they were.

    Args:
        before: The model as it was.
        after: The model as learned, with its covariance.
        names: Parameters of both to compare; those that one of them lacks are left out.

    Returns:
        Name -> `before`, `after`, `change` (whole turns left out), `sigma` (of `after`, None where
        it is not known) and `unit`.
    """
    old, new = named_values(before), named_values(after)
    sigma: dict[str, float] = {}
    if after.covariance is not None:
        spread = np.sqrt(np.maximum(np.diag(after.covariance.matrix), 0.0))
        sigma = dict(zip(after.covariance.names, spread.tolist(), strict=True))
    near = _nearest_values(before, after)
    found = {}
    for name in names:
        if name in old and name in new:
            known = sigma.get(name)
            found[name] = {
                "before": old[name][0],
                "after": new[name][0],
                "change": near[name] - old[name][0],
                "sigma": known if known is not None and np.isfinite(known) else None,
                "unit": new[name][1],
            }
    return found


def _nearest_values(before: SelfModel, after: SelfModel) -> dict[str, float]:
    """Return the values of `after`, its angles by whole turns nearest to those of `before`."""
    old = {name: value for name, (value, _) in named_values(before).items()}
    new = {name: (value, unit) for name, (value, unit) in named_values(after).items()}
    near = {name: value for name, (value, _) in new.items()}
    gears = {name: value for name, (value, _) in new.items() if name.endswith(".gear")}
    for name, (value, unit) in new.items():
        if unit == "rad" and name in old:
            # A joint's whole turn is as many of its encoder's as the gear says.
            gear = gears.get(name.replace(".theta_offset", ".gear"), 1.0)
            near[name] = float(nearest_turn(value, old[name], 2.0 * np.pi * gear))
    for turn in _rotations(old):
        if set(turn) <= set(old) & set(new):
            vector = nearest_rotation_vector(
                [new[name][0] for name in turn], [old[name] for name in turn]
            )
            near |= dict(zip(turn, vector.tolist(), strict=True))
    return near


def _rotations(names: Iterable[str]) -> list[tuple[str, ...]]:
    """Return parameters that are a rotation vector together."""
    ends = tuple(f".pose.{name}" for name in POSE_NAMES[:3])
    placed = [name.removesuffix(ends[0]) for name in names if name.endswith(ends[0])]
    return [tuple(M0_NAMES[3:]), *(tuple(f"{camera}{end}" for end in ends) for camera in placed)]


def named_values(model: SelfModel) -> dict[str, tuple[float, str]]:
    """Return value and unit of every parameter of arm and cameras, and of the lengths in them."""
    values: dict[str, tuple[float, str]] = {}
    if model.has_arm:
        arm = model.parameters
        values |= dict(
            zip(arm.names, zip(arm.values.tolist(), arm.units, strict=True), strict=True)
        )
        values |= {name: (length, "m") for name, length in links_of(model)}
    if model.cameras:
        values |= _camera_values(model)
    return values


def _camera_values(model: SelfModel) -> dict[str, tuple[float, str]]:
    names, cameras = model.camera_names, [model.cameras[name] for name in model.camera_names]
    lenses = [camera.lens for camera in cameras]
    numbers = zip(rig_values(cameras).tolist(), rig_units(len(cameras), lenses), strict=True)
    values = dict(zip(rig_names(names, lenses), numbers, strict=True))
    if len(cameras) == 2:
        apart = cameras[1].X_WC[:3, 3] - cameras[0].X_WC[:3, 3]
        values["baseline"] = (float(np.linalg.norm(apart)), "m")
    return values


def links_of(model: SelfModel) -> list[tuple[str, float]]:
    """Return the lengths of the links of a paired arm [m]; nothing for another."""
    if len(model.joints) != 4:
        return []
    try:
        upper, lower = link_lengths(model.chain)
    except ValueError:
        return []
    return [("link.upper", upper), ("link.lower", lower)]
