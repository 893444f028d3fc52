"""Where a part of a chessboard may lie on the board: turned by quarters, shifted by whole squares.

A node (x, y) of a lattice is a corner of squares; x to the right and y down as in a picture of it.
The square between (x, y) and (x + 1, y + 1) is dark where x + y is even. A quarter turn takes that
square to one whose node has x + y odd, unless the shift makes up for it: colours leave half of all
places. Boards of two even or two odd numbers of corners are printed with either colour first, so
that theirs tell nothing.
"""

import numpy as np
from numpy.typing import NDArray

_QUARTER = np.array([[0, -1], [1, 0]])


def places_of(nodes: NDArray, columns: int, rows: int) -> NDArray:
    """Return all places on a board where the part may lie.

    Args:
        nodes: Of the part, whole numbers. Shape (n, 2).
        columns: Corners in a row of the board.
        rows: Rows of corners.

    Returns:
        Nodes on the board. Shape (k, n, 2); k is 0 where the part is too large for it.
    """
    found = []
    for quarters in range(4):
        turned = nodes @ np.linalg.matrix_power(_QUARTER, quarters).T
        turned = turned - turned.min(axis=0)
        across, down = (max(0, n) for n in (columns, rows) - turned.max(axis=0))
        shifts = np.stack(np.meshgrid(np.arange(across), np.arange(down)), axis=-1).reshape(
            -1, 1, 2
        )
        placed = turned + shifts
        odd = (placed[:, 0].sum(axis=1) - nodes[0].sum() + quarters) % 2
        found.append(placed[odd == 0] if (columns + rows) % 2 else placed)
    return np.concatenate(found)


def lattice_of(points: NDArray) -> tuple[NDArray, int, int]:
    """Return the nodes of a chessboard's corners, and how many columns and rows there are.

    Args:
        points: Corners, row by row [m]. Shape (P, 3).
    """
    flat = points[:, :2] - points[:, :2].min(axis=0)
    square = np.linalg.norm(points[1:] - points[0], axis=1).min()
    nodes = np.rint(flat / square).astype(int)
    columns, rows = nodes.max(axis=0) + 1
    return nodes, int(columns), int(rows)
