"""`nico-selfmodel calibrate stereo`: learn a pair of cameras from a board."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.result_files import NoReport, stamped, write_with_report
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.vision.boards.board_detections import BoardDetections


def stereo(
    board: options.Board,
    square_mm: options.SquareMm,
    out: options.Out,
    images: options.ImagesOrNone = None,
    left: Annotated[
        str | None, typer.Option("--left", help="Its photographs by a pattern, as 'cam0/*.png'.")
    ] = None,
    right: Annotated[
        str | None, typer.Option("--right", help="The same of the right camera, 'cam1/*.png'.")
    ] = None,
    tag_mm: options.TagMm = None,
    family: options.Family = None,
    window: options.Window = 11,
    lens: options.Lens = "auto",
    known: options.KnownCameras = None,
    fix: options.Fix = None,
    free: options.Free = None,
    prior: options.Prior = None,
    tangential: options.Tangential = False,
    fixed_aspect: options.FixedAspect = False,
    loss: options.Loss = "trimmed",
    test_fraction: options.TestFraction = None,
    seed: options.SplitSeed = 0,
    name: options.ModelName = None,
    require_test_px: options.RequireTestPx = None,
    swap_cameras: Annotated[
        bool, typer.Option("--swap-cameras", help="Take left* for the right camera's, and so on.")
    ] = False,
    no_report: options.NoReport = False,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn a pair of cameras from pairs of photographs, left* and right*, of a board."""
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.vision.boards.board_detections import detect_boards

    wanted = inputs.board(board, square_mm, tag_mm, family)
    pairs, folder = _pairs(images, left, right)
    refuse_folder(out, force=force, inputs=[folder])
    task = CameraTask(
        lens_options(fix, free, prior, tangential, fixed_aspect, loss, lens),
        *(test_fraction, seed, name or inputs.name_after(folder), require_test_px, out),
        *(no_report, force, inputs.model_of(known)),
    )
    with printer.progress_bar() as progress:
        if swap_cameras:
            pairs = [(name, right, left) for name, left, right in pairs]
        found = detect_boards(pairs, wanted, window, progress)
        document = task.run(found, progress)
    printer.result(task.name, document, out, json_instead=as_json)


def _pairs(
    images: Path | None, left: str | None, right: str | None
) -> tuple[list[tuple[str, Path, Path]], Path]:
    """Return name, left and right photograph of each view, and the folder that they are called by.

    Raises:
        ValueError: If neither a folder nor two patterns are given, or both.
    """
    from nico_selfmodel.vision.boards.board_images import pairs_by_pattern, stereo_pairs

    if images is not None and left is None and right is None:
        return stereo_pairs(images), images
    if images is not None or left is None or right is None:
        raise ValueError("give a folder of photographs, or --left and --right patterns")
    pairs = pairs_by_pattern(left, right)
    return pairs, pairs[0][1].parent


def lens_options(
    fix: list[str] | None,
    free: list[str] | None,
    prior: list[str] | None,
    tangential: bool,
    fixed_aspect: bool,
    loss: str,
    lens: str,
) -> "CameraOptions":
    """Return what is estimated of a lens.

    Raises:
        ValueError: If a word is not valid.
    """
    from nico_selfmodel.estimation.cameras.camera_options import CameraOptions

    return CameraOptions.from_text(
        fix or (),
        free or (),
        prior or (),
        tangential=tangential,
        aspect=1.0 if fixed_aspect else None,
        loss=loss,
        lens=lens,
    )


@dataclass(frozen=True)
class CameraTask:
    """What is asked of cameras, once the boards are found."""

    options: "CameraOptions"
    test_fraction: float | None
    seed: int
    name: str
    require_test_px: float | None
    out: Path
    no_report: bool
    force: bool
    known: "SelfModel | None"

    def run(self, found: "BoardDetections", progress: Progress) -> dict[str, Any]:
        """Calibrate, judge and write the result folder; return its document."""
        from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
        from nico_selfmodel.estimation.cameras.known_cameras import cameras_for
        from nico_selfmodel.estimation.cameras.lens_choice import lens_of
        from nico_selfmodel.estimation.judging import judge, to_json

        if self.known is not None:
            cameras_for(self.known, found.views)  # refused before anything is learned
        train, test = found.views, None
        if self.test_fraction is not None:
            train, test = found.seen_views.split(self.test_fraction, self.seed)
        progress("learning the cameras", 0, 2)
        choice = lens_of(train, self.options)
        calibration = choice.calibration
        progress("learning the cameras", 1, 2)
        assessment = CameraAssessment.from_calibration(
            calibration, choice.options, test, self.known, choice.better
        )
        verdict = judge(assessment, require_test_px=self.require_test_px)
        document = stamped(to_json(assessment, verdict)) | {"detection": found.document}
        document["lens"] = choice.as_plain()
        progress("learning the cameras", 2, 2)
        progress("writing the result", 0, 1)
        model = calibration.self_model(self.name, found.provenance)
        report = NoReport(document)
        if not self.no_report:
            # Drawing is slow to load, and only needed once there is something to draw.
            from nico_selfmodel.viz.reports.cameras import camera_report

            report = camera_report(assessment, document, found.read_images(), model)
        write_with_report(self.out, model, report, force=self.force)
        progress("writing the result", 1, 1)
        return document
