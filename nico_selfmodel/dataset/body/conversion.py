"""A data set of one arm as a recording of a body: the chain becomes a tree without branches."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import WIDTH, BodyDataset, ObservationTable
from nico_selfmodel.dataset.body.link_joint import LinkJoint
from nico_selfmodel.dataset.body.sensors import CAMERA, POINTS, MarkerInfo, SensorInfo
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.projection import POLYNOMIAL
from nico_selfmodel.model.tree.body_tree import WORLD_NAME
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
