"""What a self-model's file keeps beside the body: of that, what commands go by is checked."""

import math
from collections.abc import Mapping
from typing import Any

from nico_selfmodel.model.document_values import LARGEST_SIGMA_M, mapping, number, numbers, sigma
from nico_selfmodel.model.noise_mixture import mixtures_of
from nico_selfmodel.names import shown


def fit(value: Any, joints: int) -> dict[str, Any]:
    """Return the statistics of a fit.

    Args:
        joints: How many the arm has.

    Raises:
        ValueError: If the noise, the range of the readings, the error that is to be expected or the
            failures of mirrors are not what they should be.
    """
    if isinstance(value, Mapping):
        mixtures_of(value)  # before the general check: it knows what its numbers must be
    found = mapping(value, "fit")
    for joint, ends in mapping(found.get("readings"), "fit.readings").items():
        lowest_and_highest = numbers(ends, f"fit.readings of {joint}")
        if lowest_and_highest.shape != (2,):
            raise ValueError(f"fit.readings of {joint} must be two numbers, got {shown(ends)}")
    expected = mapping(found.get("expected_error"), "fit.expected_error")
    needed = [key for key in ("n", "median_m", "median_px") if key in expected or key[-1] != "x"]
    if expected and not all(number(expected[key], key) > 0.0 for key in needed):
        raise ValueError(f"fit.expected_error must have positive numbers, got {shown(expected)}")
    sigma(found.get("joint_sigma_rad"), "fit.joint_sigma_rad", math.pi)
    _check_pose_noise(mapping(found.get("pose_noise"), "fit.pose_noise"), joints)
    _check_texts(mapping(found.get("mirror_failures"), "fit.mirror_failures"), "fit")
    return found


def robot(value: Any) -> dict[str, Any]:
    """Return where the robot's description is, and which of its chains was learned.

    Raises:
        ValueError: If something in it is not what it should be.
    """
    found = mapping(value, "robot")
    if found and not isinstance(found.get("urdf"), str):
        raise ValueError(f"robot.urdf must be a name or a path, got {shown(found.get('urdf'))}")
    links = ("base_link", "tip_link")
    _check_texts({key: found[key] for key in links if found.get(key) is not None}, "robot")
    for joint, angle in mapping(found.get("held"), "robot.held").items():
        number(angle, f"robot.held of {joint}")
    _check_texts(mapping(found.get("points"), "robot.points"), "robot.points")
    return found


def provenance(value: Any) -> dict[str, Any]:
    """Return where a self-model comes from.

    Raises:
        ValueError: If it is no mapping, or the individual that learned is no number.
    """
    found = mapping(value, "provenance")
    seed = found.get("seed")
    if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int) or seed < 0):
        raise ValueError(f"provenance.seed must be a whole number, got {shown(seed)}")
    mapping(found.get("mirrors"), "provenance.mirrors")
    return found


def _check_pose_noise(noise: Mapping[str, Any], joints: int) -> None:
    if not noise:
        return
    sigma(noise["sensor_sigma"], "fit.pose_noise.sensor_sigma", LARGEST_SIGMA_M)
    each = numbers(noise["joint_sigma_rad"], "fit.pose_noise.joint_sigma_rad", math.pi)
    if each.shape not in ((), (joints,)) or (each < 0.0).any():
        raise ValueError(
            f"fit.pose_noise.joint_sigma_rad must be {joints} numbers from 0, got "
            f"{shown(noise['joint_sigma_rad'])}"
        )


def _check_texts(found: Mapping[str, Any], name: str) -> None:
    for key, text in found.items():
        if not isinstance(text, str):
            raise ValueError(f"{name}.{key} must be text, got {shown(text)}")
