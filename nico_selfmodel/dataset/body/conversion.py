"""A data set of one arm as a recording of a body: the chain becomes a tree without branches."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import WIDTH, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, POSES, MarkerInfo, SensorInfo
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import POLYNOMIAL
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.model.tree.body_tree import FLANGE, WORLD_NAME
from nico_selfmodel.names import listed

TRACKER, SIDES = "tracker", ("left", "right")


def body_dataset_of(dataset: Dataset, cameras: Mapping[str, Camera] | None = None) -> BodyDataset:
    """Convert a data set.

    Args:
        dataset: Encoder readings with points or pixels of markers on the last link.
        cameras: Lenses of `left` and `right`, where they are known.

    Returns:
        The same measurements; what was seen in a mirror is not among them.

    Raises:
        DataError: If nothing was seen directly.
    """
    samples, lead = np.unique(dataset.sample, return_index=True)
    direct = dataset.mirror == ""
    parts = [(TRACKER, dataset.p_WH_measured)]
    parts += [(side, dataset.pixels[:, 2 * k : 2 * k + 2]) for k, side in enumerate(SIDES)]
    sensors, tables = [], []
    for name, values in parts:
        rows = np.flatnonzero(np.isfinite(values).all(axis=1) & direct)
        if len(rows):
            tables.append(_rows(dataset, samples, rows, values[rows], len(sensors)))
            sensors.append(_sensor(dataset, name, cameras or {}))
    if not tables:
        raise DataError(f"data set {dataset.name!r} has nothing that was seen directly")
    table = ObservationTable(*(np.concatenate(column) for column in zip(*tables, strict=True)))
    return BodyDataset(
        dataset.name,
        chain_of(dataset),
        tuple(MarkerInfo(marker, dataset.joint_names[-1]) for marker in dataset.markers),
        tuple(sensors),
        samples,
        dataset.encoders[lead],
        table,
        approach=dataset.approach[lead],
        source=dataset.source,
        seed=dataset.seed,
    )


def chain_of(dataset: Dataset) -> tuple[LinkJoint, ...]:
    """Return the joints of a data set, each on the one before it."""
    return tuple(
        LinkJoint(
            joint.name,
            WORLD_NAME if i == 0 else dataset.joint_names[i - 1],
            encoder_unit=joint.encoder_unit,
            counts_per_turn=joint.counts_per_turn,
            sign=joint.sign,
            lower=joint.lower,
            upper=joint.upper,
        )
        for i, joint in enumerate(dataset.joints)
    )


def tree_dataset_of(
    dataset: Dataset,
    links: Sequence[LinkJoint],
    markers: Sequence[MarkerInfo],
    cameras: Sequence[SensorInfo],
) -> BodyDataset:
    """Convert what the cameras of a whole body saw.

    Args:
        dataset: Encoder readings with pixels of markers.
        links: What carries each of its joints, in its order; how they are read it tells itself.
        markers: What carries each of its markers, in its order.
        cameras: The left and the right camera, and what carries them.

    Raises:
        DataError: If joints or markers have other names, or nothing was seen.
    """
    for what, here, there in (
        ("joints", dataset.joint_names, tuple(link.name for link in links)),
        ("markers", dataset.markers, tuple(marker.name for marker in markers)),
    ):
        if tuple(here) != there:
            raise DataError(
                f"data set {dataset.name!r} has the {what} {listed(here)}, expected {listed(there)}"
            )
    samples, lead = np.unique(dataset.sample, return_index=True)
    joints = tuple(
        replace(
            link,
            encoder_unit=joint.encoder_unit,
            counts_per_turn=joint.counts_per_turn,
            sign=joint.sign,
            lower=joint.lower,
            upper=joint.upper,
        )
        for link, joint in zip(links, dataset.joints, strict=True)
    )
    tables = []
    for k in range(len(cameras)):
        values = dataset.pixels[:, 2 * k : 2 * k + 2]
        rows = np.flatnonzero(np.isfinite(values).all(axis=1))
        tables.append(_rows(dataset, samples, rows, values[rows], k))
    return BodyDataset(
        dataset.name,
        joints,
        tuple(markers),
        tuple(cameras),
        samples,
        dataset.encoders[lead],
        ObservationTable(*(np.concatenate(column) for column in zip(*tables, strict=True))),
        approach=dataset.approach[lead],
        source=dataset.source,
        seed=dataset.seed,
    )


def with_lenses(data: BodyDataset, lenses: Mapping[str, Camera]) -> BodyDataset:
    """Return a recording whose cameras have lenses that are known, by their names."""
    return replace(
        data,
        sensors=tuple(
            replace(info, lens=dict(lenses[info.name].named_values)) for info in data.sensors
        ),
    )


def with_poses_of(data: BodyDataset, known: SelfModel) -> BodyDataset:
    """Return a recording that says where calibrated cameras stand to the one that is its world.

    Their distance from each other tells lengths. It stays as it is where something else stands for
    the world, or markers of known places tell lengths, and so do poses that it tells itself.

    Args:
        known: Cameras, by the recording's names; what it does not say to be uncertain counts as
            exact.
    """
    if any(m.xyz is not None for m in data.markers):
        return data
    if any(joint.motion == FLANGE for joint in data.joints):
        return data
    used = np.unique(data.observations.sensor).tolist()
    standing = [data.sensors[s] for s in used if data.sensors[s].on == WORLD_NAME]
    if any(sensor.kind in (POINTS, POSES) for sensor in standing):
        return data
    cameras = [s.name for s in standing if s.kind == CAMERA and s.X_LS is None]
    if len(cameras) < 2 or not set(cameras[:1]) <= set(known.cameras):
        return data
    world, *others = (name for name in cameras if name in known.cameras)
    X_CW = known.cameras[world].X_CW
    told = {
        name: replace(
            data.sensors[[s.name for s in data.sensors].index(name)],
            X_LS=X_CW @ known.cameras[name].X_WC,
            pose_sigma=_pose_sigma(known, world, name),
        )
        for name in others
    }
    return replace(data, sensors=tuple(told.get(s.name, s) for s in data.sensors))


def _pose_sigma(known: SelfModel, world: str, name: str) -> tuple[float, float]:
    """Return what place [m] and turn [rad] of one camera from another are uncertain by at most."""
    if known.covariance is None:
        return 0.0, 0.0
    names = known.covariance.names
    sigma = dict(zip(names, np.sqrt(np.diag(known.covariance.matrix)).tolist(), strict=True))
    (far, bent), (beside, askew) = (
        (
            max(sigma.get(f"{camera}.pose.{part}", 0.0) for part in "xyz"),
            max(sigma.get(f"{camera}.pose.{part}", 0.0) for part in ("rx", "ry", "rz")),
        )
        for camera in (name, world)
    )
    apart = known.cameras[name].X_WC[:3, 3] - known.cameras[world].X_WC[:3, 3]
    lever = float(np.linalg.norm(apart)) * askew
    return float(np.sqrt(far**2 + beside**2 + lever**2)), float(np.hypot(bent, askew))


def _rows(
    dataset: Dataset, samples: NDArray, rows: NDArray, values: NDArray, sensor: int
) -> tuple[NDArray, ...]:
    """Return the columns of `ObservationTable` for some rows."""
    index = {name: i for i, name in enumerate(dataset.markers)}
    padded = np.full((len(rows), WIDTH), np.nan)
    padded[:, : values.shape[1]] = values
    return (
        np.searchsorted(samples, dataset.sample[rows]),
        np.full(len(rows), sensor),
        np.array([index[name] for name in dataset.marker[rows].tolist()]),
        np.full(len(rows), -1),
        padded,
        dataset.mirror[rows],
    )


def _sensor(dataset: Dataset, name: str, cameras: Mapping[str, Camera]) -> SensorInfo:
    if name == TRACKER:
        return SensorInfo(TRACKER, POINTS, sigma=dataset.point_sigma_m)
    camera = cameras.get(name)
    return SensorInfo(
        name,
        CAMERA,
        sigma=dataset.pixel_sigma_px,
        image_size=dataset.image_size if camera is None else camera.image_size,
        lens=None if camera is None else dict(camera.named_values),
        lens_kind=POLYNOMIAL if camera is None else camera.lens,
    )
