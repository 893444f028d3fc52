"""What `calibrate camera`, `stereo` and `cameras` do with photographs of a board."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli import inputs, printer
from nico_selfmodel.cli.option_groups import (
    BoardChoice,
    Bounds,
    HeldOutShare,
    LensChoice,
    NamedOutput,
)
from nico_selfmodel.cli.result_files import judge_and_write
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.vision.boards.board_detections import BoardDetections
    from nico_selfmodel.viz.reports.page import Report


@dataclass(frozen=True)
class CameraTask:
    """The options of the commands, as they were given, and what is photographed."""

    images: Mapping[str, Sequence[tuple[str, Path]]]
    """Camera -> name of the view and path."""
    folder: Path
    """Where these are: what the self-model is called by."""
    board: BoardChoice
    window: int
    lens: LensChoice
    held_out: HeldOutShare
    require_test_px: float | None
    output: NamedOutput

    def run(self) -> None:
        """Find the board, learn the cameras, write the result folder and print what was found.

        Raises:
            typer.Exit: With 1 where the cameras failed.
        """
        from nico_selfmodel.vision.boards.board_detections import detect_boards_of_cameras

        self.output.refuse(self.folder)
        inputs.refuse_untested(Bounds(None, self.require_test_px), self.held_out)
        board, options = self.board.load(), self.lens.load()
        known = inputs.model_of(self.lens.known)
        name = self.output.name or inputs.name_after(self.folder)
        with printer.progress_bar() as progress:
            found = detect_boards_of_cameras(self.images, board, self.window, progress)
            document = self._learn(found, options, known, name, progress)
        printer.result(name, document, self.output)

    def _learn(
        self,
        found: "BoardDetections",
        options: "CameraOptions",
        known: "SelfModel | None",
        name: str,
        progress: Progress,
    ) -> dict[str, Any]:
        """Calibrate, judge and write; return what is in `result.json`."""
        from nico_selfmodel.estimation.cameras.camera_assessment import CameraAssessment
        from nico_selfmodel.estimation.cameras.known_cameras import cameras_for
        from nico_selfmodel.estimation.cameras.lenses.lens_choice import lens_of

        if known is not None:
            cameras_for(known, found.views)  # refused before anything is learned
        train, test = found.seen_views, None
        if self.held_out.test_fraction is not None:
            train, test = train.split(self.held_out.test_fraction, self.held_out.seed)
        progress("learning the cameras", 0, 2)
        choice = lens_of(train, options)
        calibration = choice.calibration
        progress("learning the cameras", 1, 2)
        assessment = CameraAssessment.from_calibration(
            *(calibration, choice.options, test, known, choice.better, choice.rival),
            decentred=choice.decentred,
            left_out=choice.left_out,
            lens_by_boards=choice.by_boards,
        )
        progress("learning the cameras", 2, 2)
        model = assessment.calibration.self_model(name, found.provenance)

        def draw(document: dict[str, Any]) -> "Report":
            # Drawing is slow to load, and only needed once there is something to draw.
            from nico_selfmodel.viz.reports.cameras import camera_report

            return camera_report(assessment, document, found.read_images(), model)

        more = {"detection": found.document, "lens": choice.as_plain()}
        bounds = Bounds(require_test_px=self.require_test_px)
        return judge_and_write(
            assessment, model, draw, self.output, progress, bounds=bounds, more=more
        )
