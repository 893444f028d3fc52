"""How each joint of a robot follows its commands, as it was learned; and as one YAML."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.files.folder_contents import found_at
from nico_selfmodel.files.reading import LARGEST_DOCUMENT, read_text
from nico_selfmodel.files.whole import write_whole
from nico_selfmodel.files.yaml_text import parse_yaml, yaml_text
from nico_selfmodel.model.document_values import (
    damage,
    last_mapping,
    mapping,
    mappings,
    number,
    numbers,
    texts,
)
from nico_selfmodel.model.response.step_response import LOOP, PARTS, PROFILE, step_response
from nico_selfmodel.model.self_model import ParameterCovariance
from nico_selfmodel.names import check_name, refuse_unknown, shown

FORMAT = "nico-servo-response/1"
RESPONSE_FILE = "servo_response.yaml"
"""Name of the file in a result folder."""


@dataclass(frozen=True)
class ServoResponse:
    """How one joint follows its commands.

    Raises:
        ValueError: If a number is not positive, or its kind has no such response.
    """

    joint: str
    """Its name."""
    kind: str
    """`profile`, a trapezoid that is followed with a lag, or `loop`, a loop of limited speed."""
    delay: float
    """Time from a command to the first motion [s]."""
    delay_spread: float = 0.0
    """Standard deviation of the delay from step to step [s]."""
    speed: float | None = None
    """Largest speed [rad/s]; None where no step reached it."""
    acceleration: float | None = None
    """Of a profile [rad/s^2]; None where it is too large to show."""
    rate: float | None = None
    """1 / time constant with which the end is approached [1/s]; None where it is too fast to
    show."""

    def __post_init__(self) -> None:
        """Check the numbers."""
        refuse_unknown("kind of response", self.kind, (PROFILE, LOOP))
        told = [value for value in (self.speed, self.acceleration, self.rate) if value is not None]
        if not all(0.0 < value < np.inf for value in told):
            raise ValueError(f"{self.joint}: speed, acceleration and rate must be positive")
        if not (np.isfinite(self.delay) and 0.0 <= self.delay_spread < np.inf):
            raise ValueError(f"{self.joint}: the delay must be finite, its spread not negative")
        needed = self.rate if self.kind == LOOP else self.speed or self.acceleration
        if needed is None or (self.kind == LOOP and self.acceleration is not None):
            raise ValueError(f"{self.joint}: not the numbers of a {self.kind}")

    @property
    def parts(self) -> dict[str, float]:
        """Speed, acceleration and rate, those that are known."""
        found = {name: getattr(self, name) for name in PARTS[1:]}
        return {name: value for name, value in found.items() if value is not None}

    def after(self, way: ArrayLike, time: ArrayLike) -> NDArray:
        """Return how far the joint is on its way.

        Args:
            way: From where it stood to where it was told to go, of either sign [rad].
            time: Since it was told [s]; broadcast with `way`.
        """
        way, time = np.broadcast_arrays(np.asarray(way, float), np.asarray(time, float))
        length = np.maximum(np.abs(way), 1e-12)
        x, _ = step_response(self.kind, length.ravel(), (time - self.delay).ravel(), self.parts)
        return np.sign(way) * x.reshape(way.shape)


@dataclass(frozen=True, eq=False)
class ServoResponses:
    """How the joints of a robot follow their commands, with error bars."""

    name: str
    """Of the robot."""
    joints: tuple[ServoResponse, ...]
    """One each."""
    covariance: ParameterCovariance | None = None
    """Of what was learned, by `<joint>.<part>`: delay, speed, acceleration, rate; what is not named
    is not known."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Where it came from."""

    def of(self, joint: str) -> ServoResponse:
        """Return the response of a joint.

        Raises:
            ValueError: If there is none of this name.
        """
        refuse_unknown("joint", joint, [known.joint for known in self.joints])
        return next(known for known in self.joints if known.joint == joint)


def save_responses(model: ServoResponses, path: str | Path) -> None:
    """Write responses as YAML, whole or not at all."""
    joints = [
        {key: value for key, value in vars(known).items() if value is not None}
        for known in model.joints
    ]
    covariance = {} if model.covariance is None else model.covariance.document
    document = {
        "format": FORMAT,
        "name": model.name,
        "joints": joints,
        "provenance": dict(model.provenance),
        "covariance": covariance,
    }
    write_whole(path, yaml_text(document))


def load_responses(path: str | Path) -> ServoResponses:
    """Read responses from a file, or from a result folder.

    Raises:
        DataError: If there is no such file, or it is no YAML.
        ModelError: If it is damaged or of another kind.
    """
    path = Path(path)
    if path.is_dir() and (path / RESPONSE_FILE).is_file():
        path = path / RESPONSE_FILE
    if not path.is_file():
        raise DataError(f"{found_at(path)}; expected {RESPONSE_FILE}, or a folder with one")
    document = parse_yaml(read_text(path, LARGEST_DOCUMENT), str(path))
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        found = document.get("format") if isinstance(document, dict) else document
        raise ModelError(f"{path}: expected 'format: {FORMAT}', got {shown(found)}")
    try:
        return _responses_of(document)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelError(f"{path} cannot be used: {damage(error)}") from None


def _responses_of(document: dict[str, Any]) -> ServoResponses:
    name = document["name"]
    check_name(name, "the name of the robot")
    joints = tuple(
        ServoResponse(
            entry["joint"],
            entry["kind"],
            **{
                key: number(value, key)
                for key, value in entry.items()
                if key not in ("joint", "kind")
            },
        )
        for entry in mappings(document["joints"], "joints")
    )
    known = last_mapping(document, "covariance")
    covariance = None
    if known:
        names = texts(known["names"], "names of the covariance")
        covariance = ParameterCovariance(names, numbers(known["matrix"], "covariance"))
    provenance = mapping(document.get("provenance"), "provenance")
    return ServoResponses(name, joints, covariance, provenance)
