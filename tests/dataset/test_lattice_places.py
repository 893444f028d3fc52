"""Places on a chessboard where a part of one may lie: whole squares, quarters, and colours."""

import numpy as np
import pytest

from nico_selfmodel.dataset.lattice_places import lattice_of, places_of


def nodes(columns, rows):
    return np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2)


@pytest.mark.parametrize(
    ("columns", "rows", "count"), [(9, 6, 1), (8, 5, 1), (8, 6, 2), (7, 5, 2), (5, 5, 4)]
)
def test_a_whole_board_lies_in_as_many_ways_as_it_looks_alike(columns, rows, count):
    places = places_of(nodes(columns, rows), columns, rows)
    assert len(places) == count
    assert any(np.array_equal(place, nodes(columns, rows)) for place in places)


@pytest.mark.parametrize("shift", [(0, 0), (1, 0), (2, 1)])
def test_a_part_lies_where_colours_are_its_own(shift):
    part = nodes(4, 3) + shift
    places = places_of(part, 9, 6)
    assert any(np.array_equal(place, part) for place in places)
    for place in places:
        assert place.min() >= 0
        assert (place.max(axis=0) < (9, 6)).all()
        # The square from a node to the node one right of it and one below it, as it is turned.
        right = place[part[:, 0] > part[:, 0].min()] - place[part[:, 0] < part[:, 0].max()]
        down = place[part[:, 1] > part[:, 1].min()] - place[part[:, 1] < part[:, 1].max()]
        assert (right == right[0]).all()
        assert right[0, 0] * down[0, 1] - right[0, 1] * down[0, 0] == 1
        square = np.minimum(place[0], place[0] + right[0] + down[0])
        assert (square.sum() - part[0].sum()) % 2 == 0
    # Upright and upside down 6 x 4 shifts, on its side 7 x 3: half of them by colour.
    assert len(places) == (2 * 24 + 2 * 21) // 2


def test_a_part_larger_than_the_board_lies_nowhere():
    assert len(places_of(nodes(7, 7), 9, 6)) == 0


def test_corners_of_a_board_are_nodes():
    points = np.column_stack([0.03 * nodes(5, 4), np.zeros(20)])
    found, columns, rows = lattice_of(points)
    assert (columns, rows) == (5, 4)
    assert np.array_equal(found, nodes(5, 4))
