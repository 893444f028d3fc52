"""A data set as a folder: `dataset.yaml` beside `samples.csv`."""

import warnings
from os import PathLike
from pathlib import Path

import numpy as np

from nico_selfmodel.dataset.array_hash import array_hash
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.metadata_file import metadata_text, read_metadata
from nico_selfmodel.dataset.plausibility import check_as_read
from nico_selfmodel.dataset.samples_file import read_samples, samples_text
from nico_selfmodel.errors import DataError
from nico_selfmodel.files.folder_contents import found_at
from nico_selfmodel.files.reading import real_path
from nico_selfmodel.files.whole import folder_in_place_of

METADATA_NAME = "dataset.yaml"
SAMPLES_NAME = "samples.csv"
_ARRAYS = (
    *("sample", "sweep", "marker", "mirror", "encoders", "approach"),
    *("p_WH_measured", "pixels"),
)


def load_dataset(folder: str | PathLike[str]) -> Dataset:
    """Read a data set from its folder.

    Args:
        folder: The folder, with `dataset.yaml` and `samples.csv`.

    Raises:
        DataError: If anything is missing or not valid, or the data cannot be what they say (see
            `plausibility.check_as_read`); names file, line and column.

    Warns:
        UserWarning: If a column that nobody reads looks like a misspelt one, or a joint read in
            radians turned so far that degrees seem meant.
    """
    folder = Path(folder)
    if (folder / METADATA_NAME).is_file() and not (folder / SAMPLES_NAME).is_file():
        read_metadata(folder / METADATA_NAME)  # names what it is instead
    if not any((folder / name).is_file() for name in (METADATA_NAME, SAMPLES_NAME)):
        raise DataError(
            f"{found_at(folder)}; a data set is a folder with {METADATA_NAME} and {SAMPLES_NAME}"
        )
    for name in (METADATA_NAME, SAMPLES_NAME):
        if not (folder / name).is_file():
            raise DataError(f"{folder}: {name} is missing; it is half of a data set")
    metadata = read_metadata(folder / METADATA_NAME)
    table_path = folder / SAMPLES_NAME
    columns = read_samples(table_path, [joint.name for joint in metadata["joints"]])
    try:
        dataset = Dataset(**metadata, **columns)
    except (ValueError, DataError) as error:
        raise DataError(f"{folder}: {error}") from None
    check_as_read(dataset, str(table_path))
    return dataset


def save_dataset(dataset: Dataset, folder: str | PathLike[str], force: bool = False) -> None:
    """Write a data set to a folder, whole or not at all.

    The same data set gives the same bytes.

    Args:
        folder: The folder to make; its parents are made too.
        force: Replace the data set in an existing folder; other files in it are kept.

    Raises:
        DataError: If the folder exists (without `force`) or holds no data set, cannot be written,
            or the data could not be loaded again, for what `load_dataset` refuses.
        ValueError: If `cameras` holds something that is not plain data.
    """
    folder = real_path(folder)
    _check_target(folder, force)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # whoever loads it is warned
        check_as_read(dataset, str(folder))
    texts = {METADATA_NAME: metadata_text(dataset), SAMPLES_NAME: samples_text(dataset)}
    try:
        with folder_in_place_of(folder, keep_others=True) as fresh:
            for name, text in texts.items():
                (fresh / name).write_bytes(text.encode())
    except OSError as error:
        which = f" ({error.filename})" if error.filename else ""
        raise DataError(f"{folder}: cannot be written: {error.strerror or error}{which}") from error


def content_hash(dataset: Dataset) -> str:
    """Return the hash by which a data set is known again, however its files are written.

    Returns:
        64 hexadecimal digits.
    """
    columns = {name: getattr(dataset, name) for name in _ARRAYS}
    extra = {f"extra {name}": np.array(cells, str) for name, cells in dataset.extra.items()}
    return array_hash(metadata_text(dataset), columns | extra)


def _check_target(folder: Path, force: bool) -> None:
    if not folder.exists():
        return
    if not folder.is_dir():
        raise DataError(f"{folder}: a file of this name exists; choose another name")
    if not force:
        raise DataError(
            f"{folder}: the folder exists; choose another name or ask to replace it (force)"
        )
    if not (folder / METADATA_NAME).is_file() and any(folder.iterdir()):
        raise DataError(
            f"{folder}: the folder exists and holds something that is not a data set; it is not"
            " replaced, choose another name"
        )
