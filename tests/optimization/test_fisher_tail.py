"""How rare a value of Fisher's F is."""

import pytest

from nico_selfmodel.optimization.chi_square import chi_square_tail
from nico_selfmodel.optimization.fisher_tail import fisher_tail


@pytest.mark.parametrize(
    ("above", "below", "value"),
    [(1, 1, 161.447639), (1, 10, 4.964603), (3, 7, 4.346831), (6, 10, 3.217175),
     (10, 2, 19.395897)],
)  # fmt: skip
def test_values_of_tables_are_exceeded_one_time_of_twenty(above, below, value):
    assert fisher_tail(value, above, below) == pytest.approx(0.05, rel=1e-6)


@pytest.mark.parametrize("value", [0.3, 2.0, 9.0])
def test_of_two_degrees_of_freedom_above_the_tail_is_a_power(value):
    for below in (1, 4, 40, 4000):
        told = (1.0 + 2.0 * value / below) ** (-0.5 * below)
        assert fisher_tail(value, 2, below) == pytest.approx(told, rel=1e-10)


def test_with_many_degrees_of_freedom_below_it_is_that_of_chi_square():
    for above, value in ((1, 5.0), (3, 2.0), (6, 8.0)):
        told = chi_square_tail(above * value, above)
        assert fisher_tail(value, above, 10**9) == pytest.approx(told, rel=1e-5)


def test_rare_values_are_told_far_out_and_common_ones_are_certain():
    assert 0.0 < fisher_tail(300.0, 6, 500) < 1e-150
    assert fisher_tail(0.0, 3, 5) == fisher_tail(-1.0, 3, 5) == 1.0
    assert fisher_tail(1e-9, 3, 5) == pytest.approx(1.0)


def test_no_degrees_of_freedom_are_refused():
    for above, below in ((0, 3), (3, 0)):
        with pytest.raises(ValueError, match="degrees of freedom"):
            fisher_tail(1.0, above, below)
