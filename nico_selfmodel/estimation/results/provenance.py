"""From what, and with what, an estimate was made."""

from importlib.metadata import PackageNotFoundError, version
from typing import Any

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import content_hash


def data_named(dataset: Dataset) -> dict[str, Any]:
    """Return what a self-model remembers of the data set that it was learned from.

    Args:
        dataset: The data.

    Returns:
        Name and hash, and the seed of a simulated body.
    """
    named = {"dataset": dataset.name, "dataset_sha256": content_hash(dataset)}
    return named if dataset.seed is None else {**named, "seed": dataset.seed}


def package_versions(*packages: str) -> dict[str, str]:
    """Return the versions of this package and of others, as a self-model records them.

    Args:
        packages: Names of installed distributions.

    Returns:
        Name -> version, or `not installed`.
    """
    found = {}
    for package in ("nico-selfmodel", "numpy", *packages):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
