"""With what an estimate was made."""

from importlib.metadata import PackageNotFoundError, version


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
