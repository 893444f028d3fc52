"""From what, and with what, an estimate was made."""

import re
import sys
from contextlib import suppress
from pathlib import Path
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
    return {
        name: _version(name) or "not installed" for name in ("nico-selfmodel", "numpy", *packages)
    }


def _version(package: str) -> str | None:
    """Return the version of an installed distribution, None where there is none.

    It has a folder `<name>-<version>.dist-info` (PEP 376, 427). To load `importlib.metadata`, which
    knows others, too, takes as long as to refine an arm a dozen times.
    """
    name = re.sub(r"[-_.]+", "_", package)
    folder = re.compile(rf"{name}-([^-]+)\.dist-info", re.IGNORECASE)
    for place in sys.path:
        with suppress(OSError):
            found = filter(None, (folder.fullmatch(one.name) for one in Path(place).iterdir()))
            if (own := next(found, None)) is not None:
                return own[1]
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return None
