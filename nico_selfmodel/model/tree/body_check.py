"""Parts of a body's file that no body has, such as after a slip of an editor: refused by name."""

from collections.abc import Iterable, Mapping
from typing import Any

from nico_selfmodel.model.document_values import mapping, number
from nico_selfmodel.names import listed, shown

_LIMITS = ("lower", "upper")
_MIRROR = "mirror"


def link_named(name: Any, index: Mapping[str, int], what: str) -> int:
    """Return the index of the link that something is on.

    Raises:
        ValueError: If there is none of that name.
    """
    if not isinstance(name, str) or name not in index:
        raise ValueError(f"{what} is on {shown(name)}, which is no link; there are {listed(index)}")
    return index[name]


def check_joint(entry: Mapping[str, Any]) -> None:
    """Refuse a joint that turns by nothing, or whose limits exclude every reading.

    Raises:
        ValueError: If it is one.
    """
    name = shown(entry["name"])
    for key in ("gear", "si_per_unit"):
        if number(entry[key], f"{key} of joint {name}") == 0.0:
            raise ValueError(f"{key} of joint {name} must not be 0")
    known = [number(entry[k], f"{k} of joint {name}") for k in _LIMITS if k in entry]
    if len(known) == len(_LIMITS) and known[0] > known[1]:
        raise ValueError(f"lower of joint {name} is above upper: {known[0]:g} and {known[1]:g}")


def checked_noise(value: Any) -> dict[str, float]:
    """Return standard deviations by name.

    Raises:
        ValueError: If one is no number of at least 0.
    """
    found = {str(k): number(v, f"noise of {k}") for k, v in mapping(value, "noise").items()}
    for name, sigma in found.items():
        if sigma < 0.0:
            raise ValueError(f"noise of {name} must not be negative, got {sigma:g}")
    return found


def checked_contacts(value: Any) -> dict[str, float]:
    """Return how far apart markers are where they touch, by name.

    Raises:
        ValueError: If one is no number.
    """
    return {str(k): number(v, f"contact {k}") for k, v in mapping(value, "contacts").items()}


def checked_expected(value: Any) -> dict[str, dict[str, float]]:
    """Return errors that new poses should show, by unit.

    Raises:
        ValueError: If a median or a number of poses is no number of at least 0.
    """
    found = {}
    for unit, entry in mapping(value, "expected").items():
        where = f"expected {unit}"
        found[str(unit)] = {
            k: number(v, f"{k} of {where}") for k, v in mapping(entry, where).items()
        }
        if "median" not in found[str(unit)] or min(found[str(unit)].values()) < 0.0:
            raise ValueError(f"{where} must have a median of at least 0, got {shown(entry)}")
    return found


def check_parameters(names: Iterable[str], known: Iterable[str]) -> None:
    """Refuse covariances of what the body does not have.

    Args:
        known: Names of joints, markers, sensors, planes, contacts.

    Raises:
        ValueError: If one belongs to none of these, nor to a mirror.
    """
    frames = set(known)
    for name in names:
        frame = name.rpartition(".")[0]
        if frame not in frames and not frame.startswith(f"{_MIRROR}."):
            raise ValueError(f"covariance names {shown(name)}, of which the body has nothing")
