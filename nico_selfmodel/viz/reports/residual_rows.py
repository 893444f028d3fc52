"""Residuals of every row that was held against a model, as a table to download."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from nico_selfmodel.files.csv_cells import rows_text

if TYPE_CHECKING:
    from nico_selfmodel.estimation.arm.evaluation import Evaluation

RESIDUALS_FILE = "residuals.csv"
POINT_HEADINGS = (
    *("set", "sample", "marker", "outlier", "x_m", "y_m", "z_m"),
    *("x_predicted_m", "y_predicted_m", "z_predicted_m", "error_mm"),
)
Rows = Iterator[Sequence[Any]]
Held = tuple[str, Any, NDArray | None]
"""What a set is called, how it was evaluated, and which of its rows are outliers."""


def points_csv(sets: Iterable[Held]) -> str:
    """Return measured and predicted points, one row each, as CSV.

    Args:
        sets: Of `Evaluation`; those that are None are left out.
    """
    return rows_text(POINT_HEADINGS, (row for one in sets if one[1] for row in _point_rows(*one)))


def _point_rows(name: str, found: "Evaluation", outliers: NDArray | None) -> Rows:
    seen = found.observations
    for i, error in enumerate(1e3 * found.distances):
        marker = seen.markers[seen.marker[i]]
        places = (*seen.p_WH[i].tolist(), *found.p_WH_predicted[i].tolist())
        yield name, int(seen.sample[i]), marker, flag(outliers, i), *places, float(error)


def flag(outliers: NDArray | None, row: int) -> str:
    """Say whether a row is an outlier."""
    return "yes" if outliers is not None and outliers[row] else "no"
