"""What is not known of each link, as looks at the unmarked body tell."""

import numpy as np

from nico_selfmodel.sessions.looks.expecting import MOST_UNLIKE, POINT_SIGMA
from nico_selfmodel.sessions.looks.least_unknown import (
    COLOR_SIGMA,
    COLORS,
    POINTS,
    Told,
    least_unknown,
)

LINKS = {"calm": 0, "grazed": 1, "strange": 2}
SHAPE = (20, 30)


def told(color):
    """Places tell one link, colours another, and nothing the third."""
    share = np.full((len(POINTS), 3), 1.01 * MOST_UNLIKE)
    share[1:, 0] = 0.99 * MOST_UNLIKE
    share[:, 1] *= color < 0.04
    likely = -np.abs(np.arange(len(POINTS))[:, None] - [2.0, 1.0, 0.0]) * np.ones(3)
    places = np.full((len(POINTS), 2, *SHAPE), -1)
    each = np.arange(len(POINTS))
    places[each, 0, 10, each] = 0  # of each sigma another pixel
    places[:, 1, 5, 20] = 2
    return Told(likely, share, places, LINKS, np.zeros_like(share), frozenset())


def test_a_link_is_known_as_well_as_leaves_next_to_nothing_surprising():
    found = least_unknown(told)
    assert dict(found.points) == {"calm": POINTS[2], "grazed": POINTS[1]}
    assert dict(found.colors) == {"grazed": 0.04}
    assert found.color == COLOR_SIGMA
    assert found.other == POINT_SIGMA


def test_what_is_strange_at_the_best_sigma_of_a_link_is_not_judged_nor_what_is_about_it():
    left, right = least_unknown(told).strange
    about = np.zeros(SHAPE, dtype=bool)
    about[7:14, :6] = True  # of pixel 2 in row 10
    assert np.array_equal(left, about)
    assert not right.any()  # of a link of which no sigma leaves next to nothing


def test_no_more_is_asked_where_places_tell_all():
    asked = []

    def all_calm(color):
        asked.append(color)
        known = told(0.04)
        return Told(known.likely[:, :2], np.zeros((len(POINTS), 2)), known.strange,
                    {"calm": 0, "grazed": 1}, np.zeros((len(POINTS), 2)), frozenset())  # fmt: skip

    assert not least_unknown(all_calm).colors
    assert asked == [COLORS[0]]
