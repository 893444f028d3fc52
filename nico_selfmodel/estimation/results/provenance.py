"""From what, and with what, an estimate was made."""

import sys
from pathlib import Path
from typing import Any

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.folder import content_hash


def data_named(dataset: Dataset) -> dict[str, Any]:
    """Return what a self-model remembers of the data set that it was learned from.

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
    return {package: _version(package) for package in ("nico-selfmodel", "numpy", *packages)}


def _version(package: str) -> str:
    """Return what the folder `name-version.dist-info` of an installed package says.

    It is what `importlib.metadata` reads first, which takes longer to load than a small arm.
    """
    for place in map(Path, sys.path):
        for found in place.glob(f"{package.replace('-', '_')}-*.dist-info"):
            return found.stem.partition("-")[2]
    return "not installed"
