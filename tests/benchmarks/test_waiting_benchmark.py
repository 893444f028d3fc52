"""What a user waits for at the command line, beside what its libraries alone take."""

import sys
from dataclasses import replace
from itertools import islice

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from nico_selfmodel.dataset.folder import save_dataset
from nico_selfmodel.estimation.initialization.axis_search import first_starts_of_each, random_starts
from nico_selfmodel.estimation.initialization.start_search import few_rows
from nico_selfmodel.estimation.observations.observations import Observations
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.simulated_session import simulated_session
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.vision.boards.chessboard import Board
from nico_selfmodel.viz.figures.layout.plain_figure import PlainFigure
from nico_selfmodel.viz.figures.plot_style import image_bytes, style

from .timing import best_ratio, processor_seconds

pytestmark = pytest.mark.benchmark

COMMAND = "from nico_selfmodel.cli.main import main; main()"
LIBRARIES = "import typer, rich.table, numpy, yaml"
PLAIN_REPORT = """
import io, jinja2
from matplotlib.figure import Figure
figures = [Figure(figsize=(11.0, 4.0)) for _ in range(6)]
for figure in figures:
    for axes in figure.subplots(1, 3):
        axes.plot([0.0, 1.0])
    figure.savefig(io.BytesIO(), format="svg")
"""


def python(code, *words):
    return [sys.executable, "-c", code, *map(str, words)]


def recorded(**changes):
    arm = ArmDescription.named("nico")
    protocol = replace(SweepProtocol.for_arm(arm), **changes)
    return simulated_session(arm, IMPERFECTIONS["thesis"], protocol, "few", seed=0, session=0)


def test_help_takes_little_longer_than_loading_typer():
    ours, peer = processor_seconds(python(COMMAND, "--help"), python("import typer"), rounds=9)
    print(f"{ours:.3f} s, {ours / peer:.2f} times loading Typer")
    assert ours / peer <= 1.8


def test_importing_the_package_takes_little_beside_pythons_start():
    ours, peer = processor_seconds(python("import nico_selfmodel"), python("pass"), rounds=15)
    print(f"{ours:.3f} s, {ours / peer:.2f} times Python's start")
    assert ours / peer <= 1.5


def test_reports_load_matplotlib_in_less_time_than_it_takes_itself():
    quick = "from nico_selfmodel.viz.figures.quick_artists import load_quickly; load_quickly()"
    ours, peer = processor_seconds(python(quick), python("import matplotlib.figure"), rounds=7)
    print(f"{ours:.2f} s, {ours / peer:.2f} times matplotlib's own")
    assert ours / peer <= 0.82


@pytest.mark.parametrize("report", [False, True])
def test_learning_an_arm_of_few_poses_takes_little_beside_its_libraries(tmp_path, report):
    data, out = tmp_path / "data", tmp_path / "out"
    save_dataset(recorded(circle_points=3, home_repeats=1, random_poses=28), data)
    words = ("calibrate", "kinematics", data, "--out", out, "--force")
    words = words if report else (*words, "--no-report")
    peer = python(LIBRARIES + (PLAIN_REPORT if report else ""))
    ours, theirs = processor_seconds(python(COMMAND, *words), peer)
    print(f"{ours:.2f} s, {ours / theirs:.2f} times what its libraries take")
    assert ours / theirs <= (1.3 if report else 4.5)


def test_ticks_at_once_are_drawn_in_less_time_than_one_by_one():
    def drawn(kind):
        with style():
            figure = kind(figsize=(11.0, 4.0))
            for axes in figure.subplots(1, 4):
                axes.plot(np.arange(9.0), np.arange(9.0) ** 2)
            image_bytes(figure, "svg")

    ratio = best_ratio(lambda: drawn(PlainFigure), lambda: drawn(Figure), rounds=5)
    print(f"{ratio:.2f} times matplotlib's own")
    assert ratio <= 0.6


def test_starts_at_once_take_less_time_than_one_by_one():
    seen = Observations.from_dataset(recorded())
    known, zero = np.zeros(len(seen.joints), dtype=bool), np.median(seen.angles, axis=0)

    def starts(at_once):
        drawn = random_starts(seen, known, zero, np.random.default_rng(0), at_once=at_once)
        return list(islice(drawn, 10))

    ratio = best_ratio(lambda: starts(5), lambda: starts(1), rounds=3)
    print(f"{ratio:.2f} times one by one")
    assert ratio <= 0.8


def test_starts_of_exchanged_columns_take_less_time_at_once_than_pair_by_pair():
    seen = few_rows(Observations.from_dataset(recorded()), 0, 60)
    known, zero = np.zeros(len(seen.joints), dtype=bool), np.median(seen.angles, axis=0)
    orders = [[1, 0, 2, 3], [0, 2, 1, 3], [0, 1, 3, 2]]
    exchanged = [replace(seen, angles=seen.angles[:, order]) for order in orders]
    zeros = [zero[order] for order in orders]

    def at_once():
        return first_starts_of_each(exchanged, known, zeros, 0, 3)

    def pair_by_pair():
        each = zip(exchanged, zeros, strict=True)
        rngs = [np.random.default_rng(0) for _ in exchanged]
        drawn = [
            random_starts(one, known, its, rng, at_once=3)
            for (one, its), rng in zip(each, rngs, strict=True)
        ]
        return [list(islice(starts, 3)) for starts in drawn]

    for ours, theirs in zip(at_once(), pair_by_pair(), strict=True):
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_allclose(one.gear, other.gear, rtol=1e-3)
    ratio = best_ratio(at_once, pair_by_pair, rounds=3)
    print(f"{ratio:.2f} times pair by pair")
    assert ratio <= 0.7


def test_boards_are_found_in_a_few_times_opencvs_search_and_far_below_its_exact_one(
    real_data_folder,
):
    """Corners as exact as ours are those of `findChessboardCornersSB`, told to be accurate."""
    board, folder = Board(9, 6, 0.025), real_data_folder / "stereo_chessboard"
    images = [cv2.imread(str(path), 0) for path in sorted(folder.glob("*.jpg"))]
    assert len(images) == 26
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE

    def opencv():
        for image in images:
            _, corners = cv2.findChessboardCorners(image, (9, 6), flags=flags)
            cv2.cornerSubPix(image, corners, (11, 11), (-1, -1), (3, 30, 0.1))

    def exact():
        for image in images:
            cv2.findChessboardCornersSB(image, (9, 6), flags=cv2.CALIB_CB_ACCURACY)

    def ours():
        for image in images:
            board.find(image, 11)

    ratio, of_exact = best_ratio(ours, opencv, rounds=3), best_ratio(ours, exact, rounds=1)
    print(f"{ratio:.2f} times OpenCV's search, {of_exact:.2f} of its exact one")
    assert ratio <= 1.9
    assert of_exact <= 0.2
