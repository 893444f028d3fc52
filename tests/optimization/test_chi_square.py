"""How rare a value of chi square is, beside scipy's."""

import pytest

from nico_selfmodel.optimization.chi_square import chi_square_tail


@pytest.mark.parametrize("dof", [1, 2, 3, 4, 7, 12, 45])
@pytest.mark.parametrize("value", [1e-6, 0.5, 3.0, 20.0, 90.0, 400.0])
def test_the_tail_is_that_of_scipy(dof, value):
    # Slow to load, and only one test in a thousand wants it.
    from scipy.stats import chi2

    assert chi_square_tail(value, dof) == pytest.approx(chi2.sf(value, dof), rel=1e-10)


def test_nothing_is_always_exceeded_and_without_freedom_there_is_no_tail():
    assert chi_square_tail(0.0, 3) == 1.0
    assert chi_square_tail(-1.0, 3) == 1.0
    with pytest.raises(ValueError, match="at least one degree of freedom, got 0"):
        chi_square_tail(1.0, 0)
