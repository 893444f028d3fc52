"""What `calibrate camera`, `stereo` and `cameras` do with photographs of a board."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nico_selfmodel.cli import inputs, printer
from nico_selfmodel.cli.option_groups import Bounds, HeldOut
from nico_selfmodel.cli.result_files import NoReport, stamped, write_with_report
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.vision.boards.board_detection import AnyBoard
    from nico_selfmodel.vision.boards.board_detections import BoardDetections
    from nico_selfmodel.viz.reports.page import Report


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
    """The options of the commands, as they were given, and what is photographed."""

    images: Mapping[str, Sequence[tuple[str, Path]]]
    """Camera -> name of the view and path."""
    folder: Path
    """Where these are: what the self-model is called by."""
    board: "AnyBoard"
    window: int
    options: "CameraOptions"
    known: Path | None
    test_fraction: float | None
    seed: int
    name: str | None
    require_test_px: float | None
    no_report: bool

    def run(self, out: Path, *, force: bool, as_json: bool) -> None:
        """Find the board, learn the cameras, write the result folder and print what was found.

        Raises:
            typer.Exit: With 1 where the cameras failed.
        """
        from nico_selfmodel.files.whole import refuse_folder
        from nico_selfmodel.vision.boards.board_detections import detect_boards_of_cameras

        refuse_folder(out, force=force, inputs=[self.folder])
        inputs.refuse_untested(
            Bounds(None, self.require_test_px), HeldOut(None, self.test_fraction)
        )
        known = inputs.model_of(self.known)
        name = self.name or inputs.name_after(self.folder)
        with printer.progress_bar() as progress:
            found = detect_boards_of_cameras(self.images, self.board, self.window, progress)
            model, report = self._learn(found, known, name, progress)
            progress("writing the result", 0, 1)
            write_with_report(out, model, report, force=force)
            progress("writing the result", 1, 1)
        printer.result(name, report.document, out, json_instead=as_json)

    def _learn(
        self,
        found: "BoardDetections",
        known: "SelfModel | None",
        name: str,
        progress: Progress,
    ) -> "tuple[SelfModel, Report | NoReport]":
        """Calibrate and judge; return what is to be written."""
        from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
        from nico_selfmodel.estimation.cameras.known_cameras import cameras_for
        from nico_selfmodel.estimation.cameras.lens_choice import lens_of
        from nico_selfmodel.estimation.judging import judge, to_json

        if known is not None:
            cameras_for(known, found.views)  # refused before anything is learned
        train, test = found.views, None
        if self.test_fraction is not None:
            train, test = found.seen_views.split(self.test_fraction, self.seed)
        progress("learning the cameras", 0, 2)
        choice = lens_of(train, self.options)
        calibration = choice.calibration
        progress("learning the cameras", 1, 2)
        assessment = CameraAssessment.from_calibration(
            *(calibration, choice.options, test, known, choice.better, choice.decentred),
            left_out=choice.left_out,
        )
        verdict = judge(assessment, require_test_px=self.require_test_px)
        document = stamped(to_json(assessment, verdict)) | {"detection": found.document}
        document["lens"] = choice.as_plain()
        progress("learning the cameras", 2, 2)
        model = assessment.calibration.self_model(name, found.provenance)
        if self.no_report:
            return model, NoReport(document)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.viz.reports.cameras import camera_report

        return model, camera_report(assessment, document, found.read_images(), model)
