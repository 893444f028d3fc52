"""Chapters 5 and 8.1 of the thesis: how well cameras measure, by lens model and boards."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.estimation.cameras.board_accuracy import (
    Reconstruction,
    corner_distances,
    held_out_residuals,
)
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.experiments.experiment_report import ExperimentReport, Table, bars, spread
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.systems.simulated.cameras import SimulatedCameras
from nico_selfmodel.viz.figures.experiment_charts import bar_chart

SQUARE = 0.028
"""Side of a square of the thesis' board [m]."""
BOARDS = 13
TEST_BOARDS = 20
THESIS_EDGE_SD_MM = {"fiducial set-up": 1.59, "colour set-up": 1.30}
"""SD of reconstructed edges of 28 mm squares before the body was learned, section 8.4."""

LENSES = {
    "pinhole": CameraOptions(pinned={"k1": 0.0, "k2": 0.0, "k3": 0.0}),
    "k1, k2": CameraOptions(pinned={"k3": 0.0}),
    "centre held": CameraOptions(pinned={"cx": None, "cy": None}),
    "full": CameraOptions(),
}
"""Lens models from poor to good; `centre held` is the thesis' pass with u0 and v0 nominal."""
COUNTS = (5, 13, 40)


@dataclass(frozen=True)
class StereoRow:
    """One condition, averaged over robots; lengths in mm, on boards that were held out."""

    lens: str
    """Name of the lens model."""
    boards: int
    """Boards learned from."""
    rms_px: float
    """Reprojection error of held-out boards."""
    edge_sd_mm: tuple[float, float]
    """Standard deviation of reconstructed edges: mean and SD over robots."""
    position_mm: tuple[float, float]
    """Distance of rebuilt corners from the true board: mean and SD over robots."""
    scale_error: float
    """Mean of |scale - 1| of the rebuilt boards."""
    seconds: float
    """Mean time of a calibration."""


@dataclass(frozen=True)
class StereoExperiment:
    """All conditions."""

    individuals: int
    """Simulated pairs of cameras averaged over."""
    pixel_sigma: float
    """Noise of a corner [px]."""
    by_lens: tuple[StereoRow, ...]
    """With 13 boards, over lens models."""
    by_boards: tuple[StereoRow, ...]
    """With the full lens model, over numbers of boards."""


def run_stereo(
    individuals: int = 5,
    pixel_sigma: float = 0.2,
    seed: int = 0,
    progress: Stage | None = None,
) -> StereoExperiment:
    """Learn simulated cameras under every condition.

    Args:
        individuals: Simulated pairs of cameras.
        pixel_sigma: Noise of a corner [px].
        seed: Of the first robot.
    """
    conditions = [(lens, BOARDS) for lens in LENSES]
    conditions += [("full", count) for count in COUNTS if count != BOARDS]
    rows = {}
    for done, (lens, count) in enumerate(conditions, start=1):
        cameras = [SimulatedCameras(seed + i, pixel_sigma) for i in range(individuals)]
        rows[lens, count] = _row(lens, count, cameras)
        if progress:
            progress("learning cameras", done, len(conditions))
    return StereoExperiment(
        individuals,
        pixel_sigma,
        tuple(rows[lens, BOARDS] for lens in LENSES),
        tuple(rows["full", count] for count in COUNTS),
    )


def board_points() -> np.ndarray:
    """Return the corners of the thesis' board, 9 x 6 [m]. Shape (54, 3)."""
    across, down = np.meshgrid(np.arange(9), np.arange(6))
    return SQUARE * np.stack([across, down, np.zeros_like(across)], axis=-1).reshape(-1, 3)


def _row(lens: str, count: int, cameras: list[SimulatedCameras]) -> StereoRow:
    corners = board_points()
    found = [
        _measure(
            LENSES[lens],
            pair.look_at_boards(corners, count),
            pair.look_at_boards(corners, TEST_BOARDS, session=1),
        )
        for pair in cameras
    ]
    rms, edge, position, scale, seconds = np.array(found).T
    return StereoRow(
        lens,
        count,
        float(rms.mean()),
        (float(edge.mean()), float(edge.std())),
        (float(position.mean()), float(position.std())),
        float(scale.mean()),
        float(seconds.mean()),
    )


def _measure(options: CameraOptions, train: BoardViews, test: BoardViews) -> tuple[float, ...]:
    """Return rms [px], edge SD [mm], position error [mm], scale error and seconds."""
    learned = calibrate_cameras(train, options)
    left_over = corner_distances(held_out_residuals(learned.cameras, test))
    rebuilt = Reconstruction.from_views(learned.rig, test)
    return (
        float(np.sqrt(np.mean(left_over**2))),
        1e3 * rebuilt.edge_sd,
        1e3 * float(rebuilt.errors.mean()),
        float(np.abs(rebuilt.scale - 1.0).mean()),
        learned.seconds,
    )


def report_of(results: StereoExperiment) -> ExperimentReport:
    """Return how evenly boards come out, by lens model and by number of boards."""
    thesis = ", ".join(f"{name} {sd} mm" for name, sd in THESIS_EDGE_SD_MM.items())
    head = (
        "# Learning a pair of cameras (thesis, chapters 5 and 8)\n\n"
        f"Ours: {results.individuals} simulated pairs of Nico's wide cameras, corners found to "
        f"{results.pixel_sigma:g} px; all figures on {TEST_BOARDS} held-out boards of 28 mm "
        f"squares, mean (SD over pairs). Thesis: SD of reconstructed edges on its real robot: "
        f"{thesis}.\n\n"
    )
    pairs = f"{results.individuals} simulated pairs of cameras, {results.pixel_sigma:g} px"
    tables = (
        _table(f"Held-out boards, {pairs}: lens models", results.by_lens),
        _table("Number of boards", results.by_boards, "\n"),
    )
    charts = {
        "edges_by_lens": _chart(
            results.by_lens,
            [row.lens for row in results.by_lens],
            "How evenly squares come out, by lens model",
        ),
        "edges_by_boards": _chart(
            results.by_boards,
            [str(row.boards) for row in results.by_boards],
            "How evenly squares come out, by number of boards",
            "boards learned from",
        ),
    }
    document = {**asdict(results), "thesis_edge_sd_mm": dict(THESIS_EDGE_SD_MM)}
    return ExperimentReport(head, tables, charts, document)


def _table(title: str, rows: tuple[StereoRow, ...], before: str = "") -> Table:
    headings = ("lens model", "boards", "rms [px]", "edge SD [mm]", "corner [mm]", "scale [%]", "s")
    cells = [
        [
            row.lens,
            str(row.boards),
            f"{row.rms_px:.3f}",
            spread(row.edge_sd_mm),
            spread(row.position_mm),
            f"{100.0 * row.scale_error:.3f}",
            f"{row.seconds:.2f}",
        ]
        for row in rows
    ]
    return Table(title, headings, cells, before)


def _chart(rows: tuple[StereoRow, ...], groups: list[str], title: str, xlabel: str = "") -> Any:
    """Draw the SD of edges a group, and the thesis' two figures as a last group."""
    series = [bars("ours, simulated", [*(row.edge_sd_mm for row in rows), None])]
    for i, (name, sd) in enumerate(THESIS_EDGE_SD_MM.items()):
        theirs = [*[None] * len(rows), (sd, np.nan)]
        series.append(bars(f"thesis, {name}", theirs, published=True, color=i))
    ylabel = "SD of reconstructed edges [mm]"
    return bar_chart([*groups, "thesis"], series, title=title, ylabel=ylabel, xlabel=xlabel)
