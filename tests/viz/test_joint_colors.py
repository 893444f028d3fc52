"""Colours of joints in figures and scenes."""

from itertools import combinations

import numpy as np
from matplotlib.colors import to_rgb

from nico_selfmodel.viz.figures import palette


def least_apart(count):
    colors = [np.array(to_rgb(palette.joint_color(i))) for i in range(count)]
    return min(np.linalg.norm(a - b) for a, b in combinations(colors, 2))


def test_two_dozen_joints_differ_at_least_half_as_much_as_the_first_eight():
    """Shades of a share s are 1 - s as far apart as what they are mixed of."""
    assert least_apart(24) > 0.5 * least_apart(8) > 0.05


def test_the_first_joints_have_the_colours_of_the_scheme():
    assert [palette.joint_color(i) for i in (0, 7)] == ["#4477aa", "#667788"]
