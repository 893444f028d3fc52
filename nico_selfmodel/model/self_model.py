"""The self-model: everything a body knows of itself, in one immutable object."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.model.arrays import frozen_array
from nico_selfmodel.model.chain import Chain
from nico_selfmodel.model.dh_parameters import DhParameters
from nico_selfmodel.model.dh_table import DhTable
from nico_selfmodel.model.servo_map import ServoMap


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """Covariance of named parameters; what is not named was pinned."""

    names: tuple[str, ...]
    """Parameter names as in `DhParameters.names`. Length k."""
    matrix: NDArray
    """Shape (k, k), in the squared units of the parameters."""

    def __post_init__(self) -> None:
        """Check the shape and make the array read-only."""
        k = len(self.names)
        object.__setattr__(self, "matrix", frozen_array(self.matrix, (k, k), "covariance"))


@dataclass(frozen=True, eq=False)
class Prediction:
    """Where the hand is expected, and how surely."""

    p_WH: NDArray
    """Predicted points [m]. Shape (N, 3)."""
    covariance: NDArray | None
    """Of the prediction, from what more data would cure [m^2]. Shape (N, 3, 3)."""
    noise_sigma: float | None
    """Standard deviation of a coordinate that the mechanics and the sensor leave [m]."""

    @property
    def sigma(self) -> NDArray | None:
        """Root of the mean variance of a coordinate, without the noise [m]. Shape (N,)."""
        if self.covariance is None:
            return None
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2) / 3.0)

    @property
    def total_sigma(self) -> NDArray | None:
        """As `sigma`, with the noise: the spread of a new measurement [m]. Shape (N,)."""
        if self.sigma is None or self.noise_sigma is None:
            return None
        return np.sqrt(self.sigma**2 + self.noise_sigma**2)


@dataclass(frozen=True, eq=False)
class SelfModel:
    """An arm as learned: geometry, servos, and how well they are known."""

    name: str
    """What the model is called in files and reports."""
    dh: DhTable
    """The chain as Denavit-Hartenberg rows."""
    servos: ServoMap
    """Encoder readings <-> joint displacements."""
    covariance: ParameterCovariance | None = None
    """Of the estimated parameters; None for a nominal model."""
    noise_sigma: float | None = None
    """Standard deviation of a measured coordinate about the model [m]."""
    robot: Mapping[str, Any] = field(default_factory=dict)
    """`urdf`, `base_link`, `tip_link` and `held` joints where a robot description was given."""
    fit: Mapping[str, Any] = field(default_factory=dict)
    """Statistics of the fit, for people: errors, counts, method."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Data set name and hash, package versions."""

    def __post_init__(self) -> None:
        """Check that chain and servos speak of the same joints, and freeze the mappings."""
        if self.dh.joints != self.servos.joints:
            raise ValueError(
                f"chain and servos name different joints: {self.dh.joints}, {self.servos.joints}"
            )
        if np.any(self.servos.gear <= 0.0):
            raise ValueError(f"gear must be positive, got {self.servos.gear.tolist()}")
        strangers = set(self.covariance.names if self.covariance else ()) - set(
            self.parameters.names
        )
        if strangers:
            raise ValueError(f"the covariance names unknown parameters: {sorted(strangers)}")
        if self.noise_sigma is not None:
            object.__setattr__(self, "noise_sigma", float(self.noise_sigma))
        for name in ("robot", "fit", "provenance"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    @cached_property
    def chain(self) -> Chain:
        """The same arm as lines in space."""
        return self.dh.to_chain()

    @property
    def parameters(self) -> DhParameters:
        """The named parameters."""
        return DhParameters(self.dh, self.servos)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names from the base outwards."""
        return self.dh.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self.dh.markers

    def predict(self, readings: ArrayLike, marker: str | NDArray | None = None) -> Prediction:
        """Predict tracked points from encoder readings.

        Args:
            readings: In the encoders' own units. Shape (N, n) or (n,).
            marker: Name of a tracked point, or its index for each pose; the first if omitted.

        Returns:
            Points and their covariance J C J', with C that of the parameters.

        Raises:
            ValueError: If the readings have not n columns or the marker does not exist.
        """
        readings = np.atleast_2d(np.asarray(readings, dtype=float))
        if readings.ndim != 2 or readings.shape[1] != len(self.joints):
            raise ValueError(
                f"readings must have shape (N, {len(self.joints)}) for the joints "
                f"{', '.join(self.joints)}, got {readings.shape}"
            )
        index = self.chain.marker_index(marker) if isinstance(marker, str) else marker
        index = np.broadcast_to(np.asarray(0 if index is None else index), (len(readings),))
        p, jacobian = self.parameters.predict(self.servos.to_radians(readings), index)
        if self.covariance is None:
            return Prediction(p, None, self.noise_sigma)
        names = self.parameters.names
        columns = [names.index(name) for name in self.covariance.names]
        j = jacobian[:, :, columns]
        covariance = j @ self.covariance.matrix @ np.swapaxes(j, 1, 2)
        return Prediction(p, covariance, self.noise_sigma)

    def save(self, path: str | Path) -> None:
        """Write the model as YAML, whole or not at all; floats round-trip exactly.

        Raises:
            OSError: If the folder cannot be written to.
        """
        from nico_selfmodel.model.self_model_file import save_self_model

        save_self_model(self, path)

    @classmethod
    def load(cls, path: str | Path) -> "SelfModel":
        """Read a model from YAML.

        Raises:
            ModelError: If the file is missing, of another format or version, or not valid.
        """
        from nico_selfmodel.model.self_model_file import load_self_model

        return load_self_model(path)
