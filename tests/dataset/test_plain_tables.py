"""Tables of plain cells are read and written column by column, and alike to the careful way."""

import csv
import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_selfmodel.dataset.plain_table import plain_columns, plain_integers, plain_numbers
from nico_selfmodel.files.csv_cells import number_cells, table_text, text_cells
from nico_selfmodel.files.csv_rows import parse_number, rows_of_text

ODD = st.text(st.sampled_from("019.-+eE_ naif\n,\"'\r"), max_size=5)


@given(st.lists(st.lists(ODD, min_size=1, max_size=4), min_size=1, max_size=4))
def test_what_is_read_at_once_is_what_the_careful_way_reads(cells):
    text = "".join(",".join(row) + "\n" for row in cells)
    columns = plain_columns(text)
    if columns is not None:
        rows, lines = rows_of_text(text, "t")
        assert list(zip(*columns, strict=True)) == [tuple(row) for row in rows]
        assert lines == list(range(1, len(rows) + 1))


def test_a_table_of_plain_cells_is_read_at_once():
    assert plain_columns("a,b\n1,2\n,x\n") == [["a", "1", ""], ["b", "2", "x"]]


@pytest.mark.parametrize(
    "text",
    [
        'a,"b"\n1,2\n',
        "a,'=b\n1,2\n",
        "a,b\r\n1,2\r\n",
        "a,b\n1\n",
        "a,b\n\n1,2\n",
        "a,b\n1,2",
        "a\n1\n",
    ],
)
def test_what_may_be_more_than_plain_cells_is_left_to_the_careful_way(text):
    assert plain_columns(text) is None


@given(st.lists(ODD | st.floats().map(repr) | st.just(""), min_size=1, max_size=4))
def test_numbers_read_at_once_are_those_read_one_by_one(cells):
    values = plain_numbers(cells)
    if values is not None:
        assert np.array_equal(values, [parse_number(cell) for cell in cells], equal_nan=True)


@pytest.mark.parametrize("odd", ["nan", "inf", "1_0", " ", "1e300", "x"])
def test_a_number_that_needs_a_second_look_is_not_read_at_once(odd):
    assert plain_numbers(["1", odd]) is None


@given(st.lists(ODD | st.integers().map(str), min_size=1, max_size=4))
def test_whole_numbers_read_at_once_are_those_of_int(cells):
    values = plain_integers(cells)
    if values is not None:
        assert values.tolist() == [int(cell) for cell in cells]


def test_whole_numbers_are_read_at_once_but_for_odd_ones():
    assert plain_integers(["1", "-20", "+3"]).tolist() == [1, -20, 3]
    for odd in ("1.0", "1_0", "", "9" * 19, "1\n2"):
        assert plain_integers(["1", odd]) is None


@given(st.lists(st.text(max_size=5), min_size=1, max_size=3), st.floats(allow_nan=True))
def test_a_table_that_was_written_reads_back(texts, number):
    columns = {"text": text_cells(texts), "value": number_cells([number] * len(texts))}
    text = table_text(columns)
    rows = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    assert rows[0] == ["text", "value"]
    for (cell, value), written in zip(rows[1:], texts, strict=True):
        assert cell in (written, f"'{written}")
        assert value == ("" if math.isnan(number) else repr(number))
