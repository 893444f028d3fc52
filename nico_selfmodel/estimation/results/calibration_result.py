"""What every calibration returns: parameters, errors, findings, in one form for all evidence."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.results.errors import ErrorStatistics
from nico_selfmodel.estimation.results.verdict import FEWEST_HELD_OUT

CAUSE, MISFIT, FAILURE, LAST = "cause", "misfit", "failure", "last"
OPEN, WARNING, NOTE = "open", "warning", "note"
"""Severities of a finding. All else that is wrong follows from a cause; where there is a misfit, no
direction is called unobservable; what is told last follows from the rest, or concerns held-out
data. Where nothing failed and something is left open that was asked, nothing passes either; a note
says what passed."""


_SHOWN = {"mm": 1e3, "px": 1.0, "deg": 180.0 / np.pi}
"""Unit in which errors are shown -> how many of it are one of that in which they are kept."""


@dataclass(frozen=True)
class Finding:
    """What an estimator alone can say of its result."""

    severity: str
    """`CAUSE`, `MISFIT`, `FAILURE`, `LAST`, `OPEN`, `WARNING` or `NOTE`."""
    text: str
    """What was found, and what to do about it."""


def findings(severity: str, texts: Iterable[str | None]) -> list[Finding]:
    """Return a finding of each text; None and empty texts say nothing."""
    return [Finding(severity, text) for text in texts if text]


@dataclass(frozen=True)
class Parameter:
    """An estimated, fixed or derived number."""

    value: float | None
    sigma: float | None
    """Standard deviation; 0 of a fixed parameter, None where it is not known."""
    unit: str
    free: bool = False
    """Whether it was estimated."""

    def to_json(self) -> dict[str, Any]:
        """Return it as `result.json` has it."""
        return {"value": self.value, "sigma": self.sigma, "unit": self.unit, "free": self.free}


def parameter_table(
    names: Iterable[str], values: NDArray, units: Iterable[str], sigma: Mapping[str, float]
) -> dict[str, Parameter]:
    """Return parameters by name, those of ordinary rows without a second twist left out.

    Args:
        names: Of all parameters.
        values: Shape (P,).
        units: One each.
        sigma: Standard deviations of those that were free, inf where the data do not tell.
    """
    table = {}
    for name, value, unit in zip(names, values.tolist(), units, strict=True):
        free = name in sigma
        if free or not (name.endswith(".beta") and value == 0.0):
            table[name] = Parameter(value, finite(sigma[name]) if free else 0.0, unit, free)
    return table


@dataclass(frozen=True, eq=False)
class Errors:
    """Distances between what a model predicts and what was measured."""

    position: NDArray | None = None
    """In space [m]. Shape (N,)."""
    pixels: NDArray | None = None
    """In the images [px]. Shape (M,)."""
    n: int | None = None
    """How many observations; the distances' number if omitted."""
    poses: int | None = None
    """Of how many poses, or boards."""
    compared: NDArray = field(default_factory=lambda: np.zeros(0))
    """One error a pose, or board: what held-out ones are compared by. Shape (K,)."""
    unit: str = "mm"
    """Of `compared`, and of the error that comes first: `mm`, `px` or `deg`."""
    compared_by: str = ""
    """What `compared` is of, where units do not say it: only the same is compared."""
    relative_to: float | None = None
    """What `compared` is in units of, [m or px]: it is relative; None where it is in `unit`."""
    angles: NDArray | None = None
    """Of joints [rad]. Shape (K,)."""

    @property
    def compared_size(self) -> float:
        """Size of one unit of `compared`, in `unit`."""
        return (self.relative_to or 1.0) * _SHOWN[self.unit]

    def statistics(self, unit: str) -> ErrorStatistics | None:
        """Return the summary of errors in `mm` (in metres all the same), `px` or `deg` (in rad)."""
        distances = {"mm": self.position, "px": self.pixels, "deg": self.angles}[unit]
        if distances is None or not len(distances):
            return None
        return ErrorStatistics.from_distances(distances)

    def to_json(self) -> dict[str, Any] | None:
        """Return the block of `result.json`; None where nothing was measured."""
        position, pixels, angles = map(self.statistics, ("mm", "px", "deg"))
        first = {"px": pixels, "mm": position, "deg": angles}[self.unit]
        if first is None:
            return None
        block: dict[str, Any] = {"n": first.n if self.n is None else self.n}
        if self.poses is not None:
            block["poses"] = self.poses
        if pixels is not None:
            block["pixels"] = pixels.as_dict()
        if position is not None:
            block["position_mm"] = position.as_mm()
        if angles is not None:
            block["angle_deg"] = angles.as_deg()
        return block


@dataclass(frozen=True)
class Terms:
    """How one kind of evidence calls things."""

    held_out: str = "poses"
    """What is held out: `poses`, `boards`."""
    observed: str = "observations"
    """What an outlier is one of: `training points`, `reflections`."""
    outlier_cause: str = ""
    """What many outliers hint at."""
    worse_cause: str = ""
    """What held-out errors hint at that are larger than cross-validated ones."""
    fewest: int = FEWEST_HELD_OUT
    """Of what is held out, below which nothing is shown."""
    untested: str | None = None
    """What to say where nothing was held out; what to do about it if omitted."""
    decisive: str | None = None
    """Unit (`mm`, `px`, `deg`) of held-out errors without which nothing is shown; any if None."""
    bounded: str = "mean"
    """Which statistic of the held-out errors a bound of the user's is for: `mean` or `rms`."""


@dataclass(frozen=True, eq=False, kw_only=True)
class CalibrationResult:
    """A calibration with all that it is judged by and that is written down of it."""

    method: str
    """What `result.json` calls it: `refine`, `stereo`, `body`, ..."""
    parameters: Mapping[str, Parameter]
    """All of them by name, derived ones last."""
    train: Errors | None = None
    """Inliers of the training data."""
    test: Errors | None = None
    """Held-out data; None where nothing was held out."""
    cross_validation: Errors | None = None
    """Inliers of the training data, each predicted without its fold."""
    compared_too: tuple[tuple[Errors, Errors], ...] = ()
    """What `test` and `cross_validation` are by other kinds, as pixels beside places: held-out data
    are worse where they are by any."""
    outliers: NDArray
    """Training observations that contradict the rest. Boolean, shape (N,)."""
    outlier_names: tuple[Any, ...]
    """Samples, or boards, that have one."""
    outlier_words: str = ""
    """Which they are, in words; empty where `outlier_names` says it."""
    unobservable: tuple[str, ...] = ()
    """Directions that the data do not determine, with what would cure it."""
    converged: bool
    """Whether the solver reached a minimum."""
    iterations: int
    """Of the final solution."""
    seconds: float | None
    """Time taken; None where nobody measured it."""
    findings: tuple[Finding, ...]
    """What this estimator alone can say."""
    details: Mapping[str, Any]
    """Its own blocks of `result.json`."""
    terms: Terms
    """How its evidence calls things."""

    def texts(self, severity: str) -> list[str]:
        """Return the findings of a severity in words."""
        return [found.text for found in self.findings if found.severity == severity]


def finite(value: float | None, scale: float = 1.0) -> float | None:
    """Return a number, scaled, or None where there is none: `result.json` knows no nan."""
    return float(value) * scale if value is not None and np.isfinite(value) else None
