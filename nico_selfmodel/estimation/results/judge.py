"""PASS, FAIL or NOT_EVALUATED: the checks that every calibration has to pass."""

from nico_selfmodel.estimation.results.calibration_result import (
    CAUSE,
    FAILURE,
    LAST,
    MISFIT,
    NOTE,
    OPEN,
    WARNING,
    CalibrationResult,
)
from nico_selfmodel.estimation.results.verdict import Verdict, held_out_is_worse, outliers_are_many

_UNOBSERVABLE_SHOWN = 3
"""Unobservable directions among the reasons; the result lists them all."""
_LACKING = {"mm": "no places, and no touches or distances", "px": "no pixels"}
"""What was held out that no bound in this unit can be held against."""


def verdict_on(
    result: CalibrationResult,
    require_test_mm: float | None = None,
    require_test_px: float | None = None,
) -> Verdict:
    """Judge a calibration.

    Args:
        require_test_mm: Largest held-out error in space allowed [mm].
        require_test_px: Largest held-out error in the images allowed [px].

    Returns:
        FAIL where a check fails; NOT_EVALUATED where too little was held out, or what was asked is
        left open; else PASS.
    """
    causes, misfit = result.texts(CAUSE), result.texts(MISFIT)
    if causes:
        # All else that is wrong follows from it.
        return Verdict("FAIL", (*causes, *misfit))
    checks = [
        *result.texts(FAILURE),
        *misfit,
        _outlier_reason(result),
        None if result.converged else _solver_reason(result),
        # What a model that explains nothing cannot tell says nothing of the body.
        *(_unobservable_reasons(result) if not misfit else ()),
        _held_out_reason(result),
        *result.texts(LAST),
        _bound_reason(result, require_test_mm, "mm"),
        _bound_reason(result, require_test_px, "px"),
    ]
    failed, warnings = tuple(filter(None, checks)), tuple(result.texts(WARNING))
    if failed:
        return Verdict("FAIL", failed, warnings)
    missing, notes = [*result.texts(OPEN), *_missing(result)], result.texts(NOTE)
    if not missing:
        return Verdict("PASS", tuple(notes), warnings)
    return Verdict("NOT_EVALUATED", (*missing, *(notes if result.test else ())), warnings)


def _missing(result: CalibrationResult) -> list[str]:
    """Say what a verdict would need that nothing speaks against."""
    terms, test = result.terms, result.test
    held_out = 0 if test is None else test.poses or 0
    if test is None or not held_out:
        return [terms.untested or "nothing was held out: give --test or --test-fraction"]
    if terms.decisive is not None and test.statistics(terms.decisive) is None:
        return [f"nothing that was held out has an error in {terms.decisive}: hold out more"]
    if held_out >= terms.fewest:
        return []
    few = f"only {held_out} {terms.held_out} held out, too few to show anything"
    return [f"{few}: hold out {terms.fewest}"]


def _solver_reason(result: CalibrationResult) -> str:
    return f"the solver stopped after {result.iterations} steps without reaching a minimum"


def _outlier_reason(result: CalibrationResult) -> str | None:
    share, terms = outliers_are_many(result.outliers), result.terms
    if share is None:
        return None
    which = f" ({result.outlier_words})" if result.outlier_words else ""
    return (
        f"{100 * share:.0f} % of the {terms.observed} contradict the rest{which}: "
        f"{terms.outlier_cause}"
    )


def _unobservable_reasons(result: CalibrationResult) -> list[str]:
    """Return the first sentences on unobservable directions, and how many more there are."""
    words = list(result.unobservable)
    more = len(words) - _UNOBSERVABLE_SHOWN
    if more <= 0:
        return words
    return [*words[:_UNOBSERVABLE_SHOWN], f"and {more} more unobservable directions"]


def _held_out_reason(result: CalibrationResult) -> str | None:
    """Say when held-out poses fit significantly worse than cross-validated ones."""
    terms = result.terms
    for test, crossed in ((result.test, result.cross_validation), *result.compared_too):
        if test is None or crossed is None:
            continue
        worse = held_out_is_worse(crossed.compared, test.compared)
        if worse is not None:
            found, expected = (f"{test.compared_size * median:.3g} {test.unit}" for median in worse)
            return (
                f"the held-out error (median {found}) is significantly above that of the training "
                f"{terms.held_out} in cross-validation ({expected}): {terms.worse_cause}"
            )
    return None


def _bound_reason(result: CalibrationResult, bound: float | None, unit: str) -> str | None:
    """Say when a held-out error misses a bound that the user gave."""
    if bound is None:
        return None
    if result.test is None:
        return f"--require-test-{unit} was given but nothing was held out"
    statistics = result.test.statistics(unit)
    if statistics is None:
        return f"--require-test-{unit} was given, but what was held out has {_LACKING[unit]}"
    which = result.terms.bounded
    error = getattr(statistics, which) * (1e3 if unit == "mm" else 1.0)
    if error <= bound:
        return None
    return f"{which} held-out error {error:.3f} {unit}, required at most {bound:g} {unit}"
