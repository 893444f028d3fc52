"""Colours of joints in figures and scenes."""

from itertools import combinations

import numpy as np
from matplotlib.colors import to_rgb

from nico_selfmodel.viz.figures import palette


def test_no_two_of_two_dozen_joints_share_a_colour():
    colors = [np.array(to_rgb(palette.joint_color(i))) for i in range(24)]
    apart = [np.linalg.norm(a - b) for a, b in combinations(colors, 2)]
    assert min(apart) > 0.1


def test_the_first_joints_have_the_colours_of_the_scheme():
    assert [palette.joint_color(i) for i in (0, 7)] == ["#4477aa", "#667788"]
