"""A data set is known again by its numbers and texts, to the last bit."""

import numpy as np

from nico_selfmodel.dataset.array_hash import array_hash

A = np.array([[1.0, np.nan], [0.25, -3.0]])


def test_all_nan_and_all_widths_of_text_are_one():
    other = np.frombuffer(np.array([0xFFF8000000000001], "<u8").tobytes(), "<f8")
    assert np.isnan(other).all()
    again = np.where(np.isnan(A), other, A)
    assert array_hash("", {"a": A}) == array_hash("", {"a": again}) == array_hash("", {"a": A.T.T})
    words = np.array(["left", "é"])
    assert array_hash("", {"w": words}) == array_hash("", {"w": words.astype("U40")})
    counts = np.array([1, -1])
    assert array_hash("", {"n": counts}) == array_hash("", {"n": counts.astype(np.int8)})


def test_the_last_bit_the_name_and_the_shape_count():
    changed = A.copy()
    changed[0, 0] = np.nextafter(1.0, 2.0)
    hashes = {
        array_hash("", {"a": A}),
        array_hash("x", {"a": A}),
        array_hash("", {"b": A}),
        array_hash("", {"a": A.ravel()}),
        array_hash("", {"a": A.T}),
        array_hash("", {"a": changed}),
        array_hash("", {"a": A, "b": A}),
    }
    assert len(hashes) == 7
