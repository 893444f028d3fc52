"""What `calibrate body` does with a data set of an arm and two cameras."""

from pathlib import Path
from typing import TYPE_CHECKING

from nico_selfmodel.cli import inputs, printer
from nico_selfmodel.cli.result_files import NoReport, stamped, write_with_report
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.dataset.board_views import BoardViews
    from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
    from nico_selfmodel.vision.boards.board_detection import AnyBoard


def calibrate(
    dataset: Path,
    out: Path,
    *,
    model: Path | None,
    boards: Path | None,
    board: "AnyBoard",
    board_test_fraction: float,
    stage: str,
    variant: str,
    robot: str | None,
    nominal: "NominalArm | None",
    test: Path | None,
    test_fraction: float | None,
    seed: int,
    fix: list[str] | None,
    free: list[str] | None,
    loss: str,
    effects: str,
    up: str | None,
    name: str | None,
    require_test_mm: float | None,
    require_test_px: float | None,
    no_report: bool,
    force: bool,
    as_json: bool,
) -> None:
    """Learn an arm and two cameras together, and leave a result folder.

    Raises:
        ValueError: If no self-model with both cameras is given.
    """
    from nico_selfmodel.dataset.folder import load_dataset

    if model is None:
        load_dataset(dataset)  # says what it is instead
        raise ValueError(f"{dataset} is of an arm and two cameras: give them with --model")
    from nico_selfmodel.estimation.bending.what_bends import effects_of, up_of
    from nico_selfmodel.estimation.body.body import calibrate_body
    from nico_selfmodel.estimation.body.body_options import BodyOptions
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.model.self_model_file import load_model

    refuse_folder(out, force=force, inputs=[dataset, model, boards, test, robot])
    inputs.refuse_untested(require_test_mm, require_test_px, test, test_fraction)
    pins = FixedParameters.from_text(fix or (), free or ())
    may_bend, vertical = effects_of(effects), up_of(up)
    chosen = BodyOptions(stage, variant, pins.pinned, pins.freed, loss)
    start = load_model(model)
    train, held_out = inputs.train_and_test(dataset, test, test_fraction, seed)
    with printer.progress_bar() as progress:
        views, held_boards = _boards(boards, board, board_test_fraction, seed, progress)
        progress("learning", 0, 1)
        found = calibrate_body(
            train,
            start,
            views,
            chosen,
            test=held_out,
            test_boards=held_boards,
            nominal=nominal,
            name=name,
            seed=seed,
            effects=may_bend,
            up=vertical,
        )
        document = stamped(to_json(found, judge(found, require_test_mm, require_test_px)))
        progress("learning", 1, 1)
        progress("writing the result", 0, 1)
        report = NoReport(document)
        if not no_report:
            from nico_selfmodel.viz.reports.body import body_report  # slow to load

            report = body_report(found, document)
        write_with_report(out, found.model, report, force=force)
        progress("writing the result", 1, 1)
    printer.result(found.model.name, document, out, json_instead=as_json)


def _boards(
    folder: Path | None,
    board: "AnyBoard",
    fraction: float,
    seed: int,
    progress: Progress,
) -> tuple["BoardViews | None", "BoardViews | None"]:
    """Return the boards to learn from and those held out."""
    if folder is None:
        return None, None
    from nico_selfmodel.estimation.cameras.camera_calibration import FEWEST_VIEWS
    from nico_selfmodel.vision.boards.board_detections import detect_boards

    found = detect_boards(folder, board, progress=progress).seen_views
    if not fraction or len(found) <= FEWEST_VIEWS:
        # So few are all needed to learn from; the result says that none was held out.
        return found, None
    return found.split(fraction, seed)
