"""The hash by which a data set is known again: of its numbers and texts, not of its files."""

import hashlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike


def array_hash(head: str, columns: Mapping[str, ArrayLike]) -> str:
    """Return the SHA-256 of a text and of named arrays.

    Whole numbers count as int64, others as float64 to the last bit, all nan as one, little endian;
    texts in UTF-8.

    Args:
        head: All that is not in the arrays.
        columns: Name -> numbers or texts, of any shape.

    Returns:
        64 hexadecimal digits.
    """
    found = hashlib.sha256(head.encode())
    for name, column in columns.items():
        values = np.asarray(column)
        found.update(f"\0{name} {values.shape}\0".encode())
        if values.dtype.kind == "U":
            found.update("\0".join(values.ravel().tolist()).encode())
        elif values.dtype.kind == "f":
            found.update(np.where(np.isnan(values), np.nan, values).astype("<f8").tobytes())
        else:
            found.update(values.astype("<i8").tobytes())
    return found.hexdigest()
