"""The self-model: everything a body knows of itself, in one immutable object."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.arrays import frozen_covariance
from nico_selfmodel.errors import ModelError
from nico_selfmodel.model.arm.bending import BACKLASH, Bending
from nico_selfmodel.model.arm.chain import Chain
from nico_selfmodel.model.arm.dh_parameters import DhParameters, slopes_by_angle
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.arm.loaded_posture import LoadedPosture, loaded
from nico_selfmodel.model.arm.servo_map import ServoMap
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.mirror import Mirror
from nico_selfmodel.model.cameras.mirror_rig import MirrorRig
from nico_selfmodel.model.cameras.rig_parameters import SIDES, rig_names
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.noise_mixture import NoiseMixture, mixtures_of
from nico_selfmodel.names import check_name, listed

MIRROR_FAILURES = "mirror_failures"
"""Key of `SelfModel.fit`: name of a mirror -> why its calibration failed."""


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """Covariance of named parameters; what is not named was fixed."""

    names: tuple[str, ...]
    """Parameter names as in `DhParameters.names`. Length k."""
    matrix: NDArray
    """Shape (k, k), in the squared units of the parameters."""

    def __post_init__(self) -> None:
        """Check the matrix and make it read-only."""
        if len(set(self.names)) != len(self.names):
            raise ValueError("the covariance names a parameter twice")
        matrix = frozen_covariance(self.matrix, len(self.names))
        object.__setattr__(self, "matrix", matrix)

    @property
    def document(self) -> dict[str, Any]:
        """It as plain data of a file."""
        return {"names": list(self.names), "matrix": self.matrix.tolist()}


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
    """A body as learned: arm, servos and cameras, and how well they are known.

    What was not learned yet is None, or missing from the cameras; asking for it through `dh`,
    `servos`, `chain` or `rig` says so.
    """

    name: str
    """What the model is called in files and reports."""
    table: DhTable | None = None
    """The chain as Denavit-Hartenberg rows."""
    servo_map: ServoMap | None = None
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
    cameras: Mapping[str, Camera] = field(default_factory=dict)
    """Cameras by name, of a pair `left` and `right`; the first is where others are told from."""
    pixel_sigma: float | None = None
    """Standard deviation of a pixel coordinate about the model of the cameras, of the hand where an
    arm was learned through them, else of boards' corners [px]."""
    mirrors: Mapping[str, Mirror] = field(default_factory=dict)
    """Mirrors before the cameras, by the name that data sets call them; each has its covariance."""
    bending: Bending | None = None
    """What bends in the arm; None where nothing was learned to."""

    def __post_init__(self) -> None:
        """Check that chain and servos speak of the same joints, and freeze the mappings."""
        if (self.table is None) != (self.servo_map is None):
            raise ValueError("an arm is a chain and its servos: give both or neither")
        if self.table is not None and self.servo_map is not None:
            _check_arm(self.table, self.servo_map)
        if self.bending is not None and self.bending.joints != self._joint_names:
            raise ValueError(f"what bends has the joints {self.bending.joints}: other than the arm")
        self._check_names()
        strangers = set(self.covariance.names if self.covariance else ()) - set(self._known_names())
        if strangers:
            raise ValueError(
                f"the covariance names unknown parameters: {listed(sorted(strangers))}"
            )
        for name in ("noise_sigma", "pixel_sigma"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, float(getattr(self, name)))
        for name in ("robot", "fit", "provenance", "cameras", "mirrors"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        mixtures_of(self.fit)

    def _check_names(self) -> None:
        """Refuse names that a terminal would obey."""
        check_name(self.name, "the name of a self-model", in_table=False)
        parts = {"joint": self.table.joints, "marker": self.table.markers} if self.table else {}
        named = {**parts, "camera": tuple(self.cameras), "mirror": tuple(self.mirrors)}
        for what, names in named.items():
            for name in names:
                check_name(name, f"names of {what}s", in_table=False)

    @property
    def _joint_names(self) -> tuple[str, ...]:
        return () if self.table is None else self.table.joints

    @property
    def has_arm(self) -> bool:
        """Whether chain and servos are known."""
        return self.table is not None

    @property
    def dh(self) -> DhTable:
        """The chain as Denavit-Hartenberg rows.

        Raises:
            ModelError: If the arm was not learned.
        """
        if self.table is None:
            raise ModelError(self._lack("arm", "calibrate kinematics"))
        return self.table

    @property
    def servos(self) -> ServoMap:
        """Encoder readings <-> joint displacements.

        Raises:
            ModelError: If the arm was not learned.
        """
        if self.servo_map is None:
            raise ModelError(self._lack("arm", "calibrate kinematics"))
        return self.servo_map

    @property
    def camera_names(self) -> tuple[str, ...]:
        """The cameras in the order of their parameters: left before right."""
        return SIDES if set(self.cameras) == set(SIDES) else tuple(self.cameras)

    @property
    def rig(self) -> StereoRig:
        """Both cameras.

        Raises:
            ModelError: If they were not both learned.
        """
        if set(self.cameras) != set(SIDES):
            raise ModelError(self._lack("pair of cameras", "calibrate stereo"))
        return StereoRig(self.cameras["left"], self.cameras["right"])

    def mirror_rig(self, mirror: str) -> MirrorRig:
        """Return the cameras with one of the mirrors before them.

        Raises:
            ModelError: If the cameras or that mirror were not learned; names those there are.
        """
        if not self.mirrors:
            raise ModelError(self._lack("mirror", "calibrate mirror"))
        if mirror not in self.mirrors:
            raise ModelError(f"no mirror {mirror!r}; there are {listed(self.mirrors, mirror)}")
        return MirrorRig(self.rig, self.mirrors[mirror])

    def mirror_failure(self, mirror: str) -> str | None:
        """Return why a mirror failed its calibration; None where it did not."""
        failures = self.fit.get(MIRROR_FAILURES)
        reason = failures.get(mirror) if isinstance(failures, Mapping) else None
        return None if reason is None else str(reason)

    def _lack(self, what: str, command: str) -> str:
        return f"self-model {self.name!r} has no {what}: learn it with `nico-selfmodel {command}`"

    def _known_names(self) -> tuple[str, ...]:
        arm = self.parameters.names if self.has_arm else ()
        cameras = self.camera_names
        mirrors = tuple(name for mirror in self.mirrors for name in Mirror.names_of(mirror))
        lenses = [self.cameras[name].lens for name in cameras]
        return (*arm, *rig_names(cameras, lenses), *mirrors)

    @cached_property
    def chain(self) -> Chain:
        """The same arm as lines in space, rigid: what bends is in `points`."""
        return self.dh.to_chain()

    @property
    def noise_mixtures(self) -> dict[str, NoiseMixture]:
        """The noise that the training left, by sensor, `points` or `pixels`; empty if not told."""
        return mixtures_of(self.fit)

    @property
    def parameters(self) -> DhParameters:
        """The named parameters."""
        return DhParameters(self.dh, self.servos, bending=self.bending)

    def posture(self, q: ArrayLike, approach: NDArray | None = None) -> LoadedPosture:
        """Return where the arm is, bent by its own weight, at displacements its encoders tell.

        Args:
            q: `servos.to_joint` of readings [rad], floats or Drake's scalars. Shape (N, n) or (n,).
            approach: How each encoder angle last moved, as `Observations.approach`. As `q`.
        """
        return loaded(self.dh, self.bending, q, approach)

    def points(
        self, q: ArrayLike, marker: ArrayLike = 0, approach: NDArray | None = None
    ) -> NDArray:
        """Return tracked points of the arm, bent by its own weight.

        Args:
            q: `servos.to_joint` of readings [rad], floats or Drake's scalars. Shape (N, n) or (n,).
            marker: Index of the tracked point, one for all or one a pose. Shape () or (N,).
            approach: How each encoder angle last moved, -1, 1, or 0 where it is not known, as all
                are if omitted. As `q`.

        Returns:
            p_WH [m]. Shape (N, 3) or (3,).
        """
        if self.bending is None:
            return self.chain.forward(q, marker)
        rows = np.atleast_2d(np.asarray(q))
        side = None if approach is None else np.atleast_2d(approach)
        own = self.dh.p_NH[np.broadcast_to(np.asarray(marker), (len(rows),))]
        p = self.posture(rows, side).points(own)
        return p[0] if np.ndim(q) == 1 else p

    @property
    def joints(self) -> tuple[str, ...]:
        """Names from the base outwards."""
        return self.dh.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self.dh.markers

    def predict(
        self,
        readings: ArrayLike,
        marker: str | NDArray | None = None,
        approach: ArrayLike | None = None,
    ) -> Prediction:
        """Predict tracked points from encoder readings.

        Args:
            readings: In the encoders' own units, floats or Drake's scalars. Shape (N, n) or (n,).
            marker: Name of a tracked point, or its index for each pose; the first if omitted.
            approach: How each reading last changed: -1, 1, or 0 where it is not known, as all are
                if omitted. As the readings.

        Returns:
            Points and their covariance J C J', with C that of the parameters; where a joint with
            backlash came from an unknown side, with the square of its half width.

        Raises:
            ValueError: If the readings have not n columns, the approach is of another shape, or
                the marker does not exist.
        """
        readings = np.atleast_2d(np.asarray(readings))
        if readings.ndim != 2 or readings.shape[1] != len(self.joints):
            raise ValueError(
                f"readings must have shape (N, {len(self.joints)}) for the joints "
                f"{listed(self.joints)}, got {readings.shape}"
            )
        index = self.chain.marker_index(marker) if isinstance(marker, str) else marker
        index = np.broadcast_to(np.asarray(0 if index is None else index), (len(readings),))
        side = self._side(approach, readings.shape)
        p, jacobian = self.parameters.predict(self.servos.to_radians(readings), index, side)
        if self.covariance is None:
            return Prediction(p, None, self.noise_sigma)
        names = self.parameters.names
        own = [i for i, name in enumerate(self.covariance.names) if name in names]
        j = jacobian[:, :, [names.index(self.covariance.names[i]) for i in own]]
        covariance = j @ self.covariance.matrix[np.ix_(own, own)] @ np.swapaxes(j, 1, 2)
        covariance = covariance + self._of_unknown_side(jacobian, side)
        return Prediction(p, covariance, self.noise_sigma)

    def _side(self, approach: ArrayLike | None, shape: tuple[int, ...]) -> NDArray:
        """Return how encoder angles last moved, with the wiring's sign. Shape (N, n)."""
        if approach is None:
            return np.zeros(shape)
        side = np.atleast_2d(np.asarray(approach, dtype=float))
        if side.shape != shape or not np.isin(side, (-1.0, 0.0, 1.0)).all():
            raise ValueError(f"approach must be -1, 0 or 1, of shape {shape} as the readings")
        return side * self.servos.sign

    def _of_unknown_side(self, jacobian: NDArray, side: NDArray) -> NDArray:
        """Return the covariance of points by the sides that nobody knows. Shape (N, 3, 3)."""
        if self.bending is None or BACKLASH not in self.bending.effects:
            return np.zeros((len(jacobian), 3, 3))
        half = np.where(side == 0.0, self.bending.backlash, 0.0)
        swing = slopes_by_angle(self.parameters, jacobian) * half[:, None]
        return swing @ np.swapaxes(swing, 1, 2)


def _check_arm(table: DhTable, servos: ServoMap) -> None:
    if table.joints != servos.joints:
        raise ValueError(f"chain and servos name different joints: {table.joints}, {servos.joints}")
    if np.any(servos.gear <= 0.0):
        raise ValueError(f"gear must be positive, got {servos.gear.tolist()}")
