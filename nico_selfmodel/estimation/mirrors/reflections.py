"""Reflections of known points, in the form that the estimators of mirrors work on."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError, ModelError
from nico_selfmodel.estimation.observations.matching import reading_columns
from nico_selfmodel.geometry.transform import apply
from nico_selfmodel.model.arm.dh_parameters import slopes_by_angle
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import EVERY_INTRINSIC
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import listed
from nico_selfmodel.optimization.uncertainty import root_of


@dataclass(frozen=True)
class ReflectionNoise:
    """Standard deviations of what disturbs each observation of the hand on its own."""

    pixel_sigma: float
    """Of each pixel coordinate [px]."""
    joint_sigma: float
    """Of each joint angle about its encoder, alike in both cameras [rad]."""


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """What is wrong with all rows alike: the arm and the cameras as far as they are not known."""

    root: NDArray
    """Square root of the parameters' covariance, C = root root'. Shape (K, k)."""
    by_parameter: NDArray
    """Derivatives of the points by the parameters. Shape (N, 3, K)."""
    camera_columns: tuple[tuple[int, str, str], ...] = ()
    """Column, camera and parameter of what belongs to the cameras."""
    names: tuple[str, ...] = ()
    """Of the parameters. Length K."""


@dataclass(frozen=True, eq=False)
class Reflections:
    """Points that the body knows, and where their reflections were seen."""

    mirrors: tuple[str, ...]
    """Names of the mirrors. Length M."""
    mirror: NDArray
    """Index of each row's mirror. Shape (N,)."""
    cameras: tuple[Camera, ...]
    """One camera or two; the mirrors stand in the frame of the first."""
    pixels: NDArray
    """Reflections, u and v of each camera in turn; nan where not seen [px]. Shape (N, 2 C)."""
    p_WQ: NDArray
    """Where the points themselves are, as far as the body knows [m]. Shape (N, 3)."""
    covariance: NDArray
    """Of the points, for what shared errors do not explain [m^2]; without play. (N, 3, 3)."""
    by_angle: NDArray
    """Derivatives of the points by the joint angles [m/rad]. Shape (N, 3, n)."""
    sample: NDArray
    """Number of the sample of each row. Shape (N,)."""
    pose: NDArray
    """Number of the pose of each row; samples with equal readings are one pose. Shape (N,)."""
    shared: SharedErrors | None = field(default=None)
    """What is wrong with all rows alike; None where that is not known."""
    q: NDArray | None = field(default=None)
    """Joint angles by the encoders; None where no arm holds the points [rad]. Shape (N, n)."""

    @classmethod
    def from_dataset(cls, dataset: Dataset, model: SelfModel) -> "Reflections":
        """Take the rows whose pixels are a reflection in a named mirror.

        Args:
            dataset: Encoder readings, pixels, and the name of the mirror in each row.

        Returns:
            The reflections, with the points where the model predicts them.

        Raises:
            DataError: If no row is a reflection, or joints, units or markers are not the model's.
            ModelError: If the model has no arm or no cameras.
        """
        rows = np.flatnonzero((dataset.mirror != "") & seen_by_any(dataset.pixels))
        if not rows.size:
            raise DataError(
                f"data set {dataset.name!r} has no reflection: the column `mirror` must name the "
                "mirror in rows whose pixels were seen in it"
            )
        return cls.of_rows(dataset, model, rows, dataset.mirror[rows].tolist())

    @classmethod
    def of_rows(
        cls, dataset: Dataset, model: SelfModel, rows: NDArray, mirrors: list[str]
    ) -> "Reflections":
        """Take chosen rows, as if seen in mirrors of these names; raises as `known_points`."""
        names = tuple(dict.fromkeys(mirrors))
        index = np.array([names.index(name) for name in mirrors], dtype=int)
        points = known_points(dataset, model, rows)
        return cls(
            names,
            index,
            model.rig.cameras,
            dataset.pixels[rows],
            points.p_WH,
            np.zeros((len(rows), 3, 3)),
            points.by_angle,
            dataset.sample[rows],
            dataset.pose[rows],
            points.shared,
            points.q,
        )

    def __len__(self) -> int:
        """Return the number of rows N."""
        return len(self.pixels)

    @property
    def seen(self) -> NDArray:
        """Which coordinates were measured. Boolean, shape (N, 2 C)."""
        return np.asarray(np.isfinite(self.pixels))

    @property
    def p_LQ(self) -> NDArray:
        """The points in the frame of the first camera [m]. Shape (N, 3)."""
        return apply(self.cameras[0].X_CW, self.p_WQ)

    def select(self, keep: NDArray) -> "Reflections":
        """Return the chosen rows. `keep` is a boolean mask or an index."""
        arrays = ("mirror", "pixels", "p_WQ", "covariance", "by_angle", "sample", "pose")
        shared = self.shared
        if shared is not None:
            shared = replace(shared, by_parameter=shared.by_parameter[keep])
        q = None if self.q is None else self.q[keep]
        return replace(
            self, shared=shared, q=q, **{name: getattr(self, name)[keep] for name in arrays}
        )

    def of(self, mirror: str) -> "Reflections":
        """Return the rows of one mirror, which is then the only one."""
        rows = self.select(self.mirror == self.mirrors.index(mirror))
        return replace(rows, mirrors=(mirror,), mirror=np.zeros(len(rows), dtype=int))


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Where a self-model expects its points in chosen rows of a data set."""

    p_WH: NDArray
    """Predicted points [m]. Shape (N, 3)."""
    by_angle: NDArray
    """Derivatives by the joint angles [m/rad]. Shape (N, 3, n)."""
    shared: SharedErrors | None
    """From the model's covariance; None where it has none."""
    q: NDArray
    """Joint angles by the encoders [rad]. Shape (N, n)."""


def known_points(dataset: Dataset, model: SelfModel, rows: NDArray) -> KnownPoints:
    """Predict the points of chosen rows, with what the model knows of its own errors.

    Args:
        rows: Indices. Shape (N,).

    Raises:
        DataError: If joints, units or markers are not the model's.
        ModelError: If the model has no arm or no cameras.
    """
    if not model.cameras:
        raise ModelError(
            f"self-model {model.name!r} has no cameras, so that it cannot look into a mirror: "
            "learn them with `nico-selfmodel calibrate stereo`"
        )
    columns = reading_columns(model, dataset)
    unknown = set(dataset.marker[rows].tolist()) - set(model.markers)
    if unknown:
        raise DataError(
            f"data set {dataset.name!r} tracks {listed(sorted(unknown))}, which the self-model "
            f"does not know; it knows {listed(model.markers)}"
        )
    marker = np.array([model.markers.index(name) for name in dataset.marker[rows].tolist()])
    angles = model.servos.to_radians(dataset.encoders[rows][:, columns])
    side = dataset.approach[rows][:, columns] * model.servos.sign
    p, slopes = model.parameters.predict(angles, marker, side)
    by_angle = slopes_by_angle(model.parameters, slopes)
    q = model.servos.to_joint(dataset.encoders[rows][:, columns])
    return KnownPoints(p, by_angle, _shared_errors(model, slopes), q)


def _shared_errors(model: SelfModel, slopes: NDArray) -> SharedErrors | None:
    """Return what the model's covariance says of all rows alike."""
    if model.covariance is None:
        return None
    arm, known = model.parameters.names, model.covariance.names
    by_parameter = np.zeros((*slopes.shape[:2], len(known)))
    cameras = []
    for column, name in enumerate(known):
        camera, _, part = name.partition(".")
        if name in arm:
            by_parameter[:, :, column] = slopes[:, :, arm.index(name)]
        elif camera in model.cameras and (part in EVERY_INTRINSIC or part.startswith("pose.")):
            cameras.append((column, camera, part))
    root = root_of(model.covariance.matrix)
    return SharedErrors(root, by_parameter, tuple(cameras), known)


def seen_by_any(pixels: NDArray) -> NDArray:
    """Return which rows at least one camera saw. Shape (N, 2 C) -> (N,)."""
    return np.asarray(np.isfinite(pixels).any(axis=1))
