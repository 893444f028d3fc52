"""What every test shares: one BLAS thread, Hypothesis without a clock, the real measurements."""

import os
from pathlib import Path

# Before numpy is imported: two BLAS threads make small factorisations many times slower.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MPLBACKEND", "Agg")

import hypothesis
import pytest

# The clock of a busy machine is no property of the code. CI must not depend on the day's luck.
hypothesis.settings.register_profile("project", deadline=None, derandomize="CI" in os.environ)
hypothesis.settings.load_profile("project")

PROJECT_ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def project_root() -> Path:
    """Return the folder that holds pyproject.toml."""
    return PROJECT_ROOT


@pytest.fixture(scope="session")
def real_data_folder() -> Path:
    """Return the folder of real measurements, or skip the test with the reason."""
    named = os.environ.get("NICO_DATA")
    folder = Path(named) if named else PROJECT_ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        source = "$NICO_DATA" if named else "no $NICO_DATA, and"
        pytest.skip(f"no real measurements: {source} {folder} is not a folder")
    return folder
