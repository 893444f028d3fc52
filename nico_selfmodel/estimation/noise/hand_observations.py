"""New observations of the hand held against a self-model that knows how well it knows itself.

Pixels of a model with cameras and measured points of one without are the same to what follows:
coordinates, their derivatives by the named parameters, and what disturbs them.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import ModelError
from nico_selfmodel.estimation.noise.hand_noise import HandNoise, whitening_of
from nico_selfmodel.estimation.observations.hand_rows import HandPixels, HandPoints, HandRows
from nico_selfmodel.estimation.observations.matching import check_markers
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.estimation.observations.pixel_observations import PixelObservations, columns_of
from nico_selfmodel.model.arm.bending import BACKLASH
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.names import refuse_unknown

SENSORS = ("auto", "pixels", "points")
"""`auto`: pixels where the model has cameras and the data have pixels, else points."""
JOINT_SIGMA = "joint_sigma_rad"
"""Key of `SelfModel.fit`: standard deviation of a joint angle about its encoder [rad]."""


@dataclass(frozen=True, eq=False)
class HandObservations:
    """Rows of data as a model sees them."""

    block: HandRows
    """Residuals and derivatives by name."""
    x: NDArray
    """Values of the block's names in the model. Shape (P,)."""
    noise: HandNoise
    """What disturbs the observations."""
    sample: NDArray
    """Number of the pose of each row. Shape (N,)."""

    def __len__(self) -> int:
        """Return the number of rows N."""
        return len(self.sample)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, of the arm and where there are pixels of the cameras."""
        return self.block.names

    @property
    def seen(self) -> NDArray:
        """Which coordinates were measured. Boolean, shape (N, k)."""
        return self.block.seen

    @property
    def sensor(self) -> str:
        """What measured the hand: `pixels` or `points`."""
        return "pixels" if isinstance(self.block, HandPixels) else "points"

    @property
    def arm(self) -> Observations:
        """Encoder angles, tracked points and samples of the rows."""
        return self.block.rows

    def whitening(self) -> NDArray:
        """Return the whitening by the noise alone. Shape (N, k, k)."""
        return self.noise.whitening(self.block.by_angle(self.x), self.seen)

    def innovations(self, covariance: NDArray) -> "Innovations":
        """Return what is new in each row.

        Args:
            covariance: Of `names`, zero for what is taken as known. Shape (P, P).

        Returns:
            Innovations with their own covariance, S = R + J C J'.
        """
        predicted, jacobian = self.block.project(self.x)
        r = (self.block.measured - predicted).T
        slopes = np.ascontiguousarray(jacobian.transpose(2, 1, 0)) * self.seen[:, :, None]
        model = slopes @ covariance @ np.swapaxes(slopes, 1, 2)
        by_angle = self.block.by_angle(self.x)
        swing = self.by_side(by_angle)
        whole = self.noise.covariance(by_angle) + swing @ np.swapaxes(swing, 1, 2) + model
        return Innovations(np.where(self.seen, r, 0.0), slopes, whole, self.seen)

    def by_side(self, by_angle: NDArray) -> NDArray:
        """Return what half widths of backlash do where nobody tells from which side a joint came.

        Args:
            by_angle: Derivatives of the rows' coordinates by the joint angles. Shape (N, k, n).

        Returns:
            Zero where the side is known, or there is no backlash. Shape (N, k, n).
        """
        joints = self.arm.joints
        at = {name: i for i, name in enumerate(self.names)}
        half = [self.x[at[name]] if (name := f"{j}.{BACKLASH}") in at else 0.0 for j in joints]
        return by_angle * np.where(self.arm.approach == 0.0, half, 0.0)[:, None]


@dataclass(frozen=True, eq=False)
class Innovations:
    """Measured minus predicted coordinates of rows, and what was to be expected of them."""

    residuals: NDArray
    """Zero where not measured. Shape (N, k)."""
    slopes: NDArray
    """Derivatives of the predictions by the named parameters. Shape (N, k, P)."""
    covariance: NDArray
    """Of the residuals, where the model holds. Shape (N, k, k)."""
    seen: NDArray
    """Which coordinates were measured. Boolean, shape (N, k)."""

    @property
    def whitened(self) -> tuple[NDArray, NDArray]:
        """Residuals and derivatives of unit variance. Shapes (N, k) and (N, k, P)."""
        w = whitening_of(self.covariance, self.seen)
        return (w @ self.residuals[:, :, None])[:, :, 0], w @ self.slopes

    @property
    def nis(self) -> NDArray:
        """Normalised innovations squared, v' S^-1 v: chi-square of `dof`. Shape (N,)."""
        return np.sum(self.whitened[0] ** 2, axis=1)

    @property
    def dof(self) -> NDArray:
        """How many coordinates of each row were measured. Shape (N,)."""
        return self.seen.sum(axis=1)


def hand_observations_of(
    model: SelfModel, dataset: Dataset, sensor: str = "auto"
) -> HandObservations:
    """Hold data against a model.

    Args:
        model: The model; its world is its left camera's frame where pixels count.
        dataset: Encoder readings, and pixels or measured points in the model's world.
        sensor: One of `SENSORS`.

    Returns:
        The rows in which something was seen.

    Raises:
        DataError: If joints, units or markers differ, or nothing was seen.
        ModelError: If the model does not say what noise to expect, or its world is not its
            camera's.
        ValueError: If there is no such sensor.
    """
    pixels = by_pixels(model, dataset, sensor)
    dataset = columns_of(model, dataset)
    seen = np.isfinite(dataset.pixels).any(axis=1) | dataset.measured
    check_markers(model, dataset, seen)
    return (_by_pixels if pixels else _by_points)(model, dataset)


def by_pixels(model: SelfModel, dataset: Dataset, sensor: str = "auto") -> bool:
    """Return whether data are held against a model by their pixels, not by their measured points.

    Raises:
        ModelError: If there are nothing but pixels, and the model has no cameras.
        ValueError: If there is no such sensor.
    """
    refuse_unknown("sensor", sensor, SENSORS)
    has_pixels = bool(np.isfinite(dataset.pixels).any())
    has_cameras = set(model.cameras) == set(SIDES)
    if sensor == "auto" and has_pixels and not has_cameras and not dataset.measured.any():
        raise ModelError(
            f"self-model {model.name!r} has no cameras, and data set {dataset.name!r} holds "
            "nothing but pixels: learn arm and cameras together with `nico-selfmodel calibrate "
            "body`, or record measured points"
        )
    return sensor == "pixels" or (sensor == "auto" and has_pixels and has_cameras)


def covariance_of(model: SelfModel, names: tuple[str, ...]) -> NDArray:
    """Return the covariance of named parameters, zero for those the model takes as known."""
    known = model.covariance
    if known is None:
        return np.zeros((len(names), len(names)))
    return laid_out(known.names, known.matrix, names)


def laid_out(own: tuple[str, ...], covariance: NDArray, names: tuple[str, ...]) -> NDArray:
    """Return a covariance in the order of other names, zero for those it does not speak of.

    Args:
        own: Names of the covariance. Length k.
        covariance: Shape (k, k).
        names: Wanted names. Length P.

    Returns:
        Shape (P, P).
    """
    matrix, index = np.zeros((len(names), len(names))), {name: i for i, name in enumerate(names)}
    kept = [i for i, name in enumerate(own) if name in index]
    places = [index[own[i]] for i in kept]
    matrix[np.ix_(places, places)] = covariance[np.ix_(kept, kept)]
    return matrix


def _by_pixels(model: SelfModel, dataset: Dataset) -> HandObservations:
    rig = model.rig
    if not np.allclose(rig.left.X_WC, np.eye(4), atol=1e-12):
        raise ModelError(
            f"the world of self-model {model.name!r} is not its left camera's frame: learn arm and "
            "cameras together with `nico-selfmodel calibrate body`"
        )
    observations = PixelObservations.from_dataset(dataset, model.markers)
    block = HandPixels(observations, model.parameters, rig.lenses)
    sensor = dataset.pixel_sigma_px or model.pixel_sigma
    if sensor is None:
        raise ModelError(
            f"neither self-model {model.name!r} nor data set {dataset.name!r} states what a pixel "
            "is uncertain by: write pixel_sigma_px into the dataset.yaml of the latter"
        )
    noise = HandNoise(sensor, float(model.fit.get(JOINT_SIGMA, 0.0)))
    x = np.concatenate([model.parameters.values, rig.values])
    return HandObservations(block, x, noise, observations.arm.sample)


def _by_points(model: SelfModel, dataset: Dataset) -> HandObservations:
    observations = Observations.from_dataset(dataset, model.markers)
    play = float(model.fit.get(JOINT_SIGMA, 0.0))
    # A model that does not tell play from noise holds both in its noise.
    stated = (dataset.point_sigma_m or 1e-4) if play else model.noise_sigma
    if stated is None:
        raise ModelError(f"self-model {model.name!r} states no noise_sigma_m: learn it anew")
    block = HandPoints(observations, model.parameters)
    noise = HandNoise(float(stated), play)
    return HandObservations(block, model.parameters.values, noise, observations.sample)


def with_values(model: SelfModel, names: tuple[str, ...], x: NDArray) -> SelfModel:
    """Return a model with other values of arm and, where named, cameras.

    Args:
        names: Names as of `HandObservations`: the arm's parameters, then the cameras' if there are
            pixels.
        x: Their values. Shape (P,).

    Raises:
        ModelError: If a gear or a focal length is not positive.
    """
    split = len(model.parameters.names)
    parameters = model.parameters.with_values(x[:split])
    try:
        cameras = dict(model.cameras)
        if len(names) > split:
            rig = model.rig.with_values(x[split:])
            cameras = {"left": rig.left, "right": rig.right}
        return replace(
            model,
            table=parameters.table,
            servo_map=parameters.servos,
            cameras=cameras,
            bending=parameters.bending,
        )
    except ValueError as error:
        raise ModelError(f"no such body can be: {error}") from error
