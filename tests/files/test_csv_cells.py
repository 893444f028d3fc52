"""Text that a spreadsheet would take for a formula is none any more, and reads back as it was."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.files.csv_cells import original_cell, safe_cell


@pytest.mark.parametrize("text", ["=cmd|' /C calc'!A0", "+1+1", "-x", "@SUM(A1)", "\tx", "'=1"])
def test_a_formula_becomes_text(text):
    assert safe_cell(text) == f"'{text}"


@pytest.mark.parametrize("text", ["-1.5", "+3", "-1e-7", "", "a", "a=b", "'tis", "left01.png"])
def test_numbers_and_plain_words_stay(text):
    assert safe_cell(text) == text


@given(st.text(st.sampled_from("'=+-@\ta1.e"), max_size=6) | st.text())
def test_every_cell_reads_back(text):
    cell = safe_cell(text)
    assert original_cell(cell) == text
    assert not cell.startswith(("=", "@", "\t"))
