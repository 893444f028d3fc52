"""matplotlib as reports load it: the same artists, without help, and only where none is there."""

import subprocess
import sys

import pytest


def said(code: str) -> list[str]:
    """Return the words that code prints in a Python of its own."""
    ran = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    return ran.stdout.split()


ARTISTS = """
from matplotlib.artist import Artist
from matplotlib.lines import Line2D
class Own(Line2D): pass
line = Own([0.0, 1.0], [2.0, 3.0])
line.set(linewidth=7.0)
print(line.get_linewidth(), "Supported" in str(Line2D.set.__doc__), "lw" in str(Own.set.__doc__))
"""


def test_artists_are_set_as_ever_and_only_own_ones_have_help():
    assert said("import nico_selfmodel.viz.reports" + ARTISTS) == ["7.0", "False", "True"]


@pytest.mark.slow
def test_a_matplotlib_that_is_there_keeps_its_help():
    before = "import matplotlib.figure, nico_selfmodel.viz.reports"
    assert said(before + ARTISTS) == ["7.0", "True", "True"]
