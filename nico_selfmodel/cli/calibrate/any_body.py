"""What commands that learn do with a recording of any body."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from nico_selfmodel.cli import inputs, printer
from nico_selfmodel.cli.result_files import stamped, write_with_report

if TYPE_CHECKING:
    from nico_selfmodel.dataset.body.body_dataset import BodyDataset
    from nico_selfmodel.estimation.monitoring.body_relearning import BodyUpdate
    from nico_selfmodel.estimation.tree.tree_setup import Description
    from nico_selfmodel.model.cameras.camera import Camera
    from nico_selfmodel.progress import Progress
    from nico_selfmodel.vision.boards.board_detection import AnyBoard

NOISE_IS_KNOWN = "a body knows the noise of its joints, and leaves out what contradicts it"
"""Why a command does not take how poses are weighed where its model is a body."""


def calibrate(
    dataset: Path,
    out: Path,
    *,
    test: Path | None,
    test_fraction: float | None,
    seed: int,
    fix: list[str] | None,
    free: list[str] | None,
    prior: list[str] | None,
    robot: str | None,
    cameras: Path | None,
    name: str | None,
    require_test_mm: float | None,
    require_test_px: float | None,
    no_report: bool,
    force: bool,
    as_json: bool,
    boards: Path | None = None,
    board: "AnyBoard | None" = None,
    effects: str = "auto",
    up: str | None = None,
    robot_sigma: str | None = None,
) -> NoReturn:
    """Learn a body from poses and observations, and leave a result folder."""
    from nico_selfmodel.estimation.bending.what_bends import effects_of, up_of
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
    from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
    from nico_selfmodel.estimation.tree.tree_result import body_model
    from nico_selfmodel.estimation.tree.tree_setup import Wishes, priors_of, robot_sigmas_of
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.result_folder.writing import write_result

    refuse_folder(out, force=force, inputs=[dataset, test, robot, cameras, boards])
    inputs.refuse_untested(require_test_mm, require_test_px, test, test_fraction)
    wishes = Wishes(FixedParameters.from_text(fix or (), free or ()), priors_of(prior or ()))
    off = None if robot_sigma is None else robot_sigmas_of(robot_sigma)
    if off is not None and robot is None:
        raise ValueError("--robot-sigma says how far a description may be off: give --robot too")
    may_bend, vertical = effects_of(effects), up_of(up)
    train, held_out = _train_and_test(dataset, test, test_fraction, seed)
    lenses = _lenses(cameras, train)
    with printer.progress_bar() as progress:
        if boards is not None and board is not None:
            train = _with_boards(train, boards, board, progress)
        progress("learning", 0, 1)
        description = None if robot is None else _described(robot, train, lenses, off)
        found = calibrate_tree(
            train,
            test=held_out,
            description=description,
            lenses=lenses,
            wishes=wishes,
            name=name,
            seed=seed,
            effects=may_bend,
            up=vertical,
        )
        verdict = judge(found, require_test_mm, require_test_px)
        document = stamped(to_json(found, verdict))
        progress("learning", 1, 1)
        progress("writing the result", 0, 1)
        files: dict[str, str] = {}
        if not no_report:
            # Drawing is slow to load, and only needed once there is something to draw.
            from nico_selfmodel.viz.reports.tree import tree_report

            files = tree_report(found, document).files()
        write_result(out, body_model(found), document, files, force=force)
        progress("writing the result", 1, 1)
    printer.result(found.name, document, out, json_instead=as_json)


def calibrate_mirrors(
    dataset: Path,
    model: Path,
    out: Path,
    *,
    test: Path | None,
    test_fraction: float | None,
    seed: int,
    name: str | None,
    require_test_px: float | None,
    force: bool,
    as_json: bool,
) -> NoReturn:
    """Learn mirrors in which a known body saw itself, and leave a result folder."""
    from nico_selfmodel.estimation.judging import judge, to_json
    from nico_selfmodel.estimation.tree.mirrors.body_mirrors import calibrate_body_mirrors
    from nico_selfmodel.model.tree.body_model import load_body

    inputs.refuse_untested(None, require_test_px, test, test_fraction)
    body = load_body(model)
    train, held_out = _train_and_test(dataset, test, test_fraction, seed)
    with printer.progress_bar() as progress:
        progress("learning mirrors", 0, 1)
        learned = calibrate_body_mirrors(train, body, test=held_out, name=name)
        verdict = judge(learned.found, None, require_test_px)
        document = stamped(to_json(learned.found, verdict))
        progress("learning mirrors", 1, 1)
        progress("writing the result", 0, 1)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.viz.reports.tree import tree_report

        report = tree_report(learned.found, document)
        write_with_report(out, learned.model, report, force=force)
        progress("writing the result", 1, 1)
    printer.result(learned.model.name, document, out, json_instead=as_json)


def rezero(
    model: Path,
    dataset: Path,
    out: Path,
    *,
    joints: list[str] | None,
    force: bool,
    as_json: bool,
) -> NoReturn:
    """Find the zeros of a body's encoders again, and leave a result folder."""
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.estimation.monitoring.body_relearning import rezero_body
    from nico_selfmodel.model.tree.body_model import load_body

    body, data = load_body(model), load_body_dataset(dataset)
    document = written(rezero_body(body, data, joints), out, force=force)
    printer.result(body.name, document, out, json_instead=as_json)


def calibrate_tool(
    dataset: Path,
    model: Path,
    out: Path,
    *,
    tool: str | None,
    test: Path | None,
    test_fraction: float | None,
    seed: int,
    force: bool,
    as_json: bool,
) -> NoReturn:
    """Learn where a tool's tip is on a body's link, and leave a result folder."""
    from nico_selfmodel.estimation.monitoring.body_relearning import calibrate_body_tool
    from nico_selfmodel.model.tree.body_model import load_body

    body = load_body(model)
    train, held_out = _train_and_test(dataset, test, test_fraction, seed)
    update = calibrate_body_tool(body, train, tool=tool, test=held_out)
    document = written(update, out, force=force)
    printer.result(body.name, document, out, json_instead=as_json)


def written(update: "BodyUpdate", out: Path, *, force: bool) -> dict[str, Any]:
    """Write what was learned anew of a body, with its report; return its `result.json`."""
    from nico_selfmodel.estimation.judging import judge, to_json

    document = stamped(to_json(update, judge(update)))
    # Drawing is slow to load, and only needed once there is something to draw.
    from nico_selfmodel.viz.reports.tree import tree_report

    write_with_report(out, update.model, tree_report(update.found, document), force=force)
    return document


def _train_and_test(
    dataset: Path, test: Path | None, fraction: float | None, seed: int
) -> "tuple[BodyDataset, BodyDataset | None]":
    """Load the training data, and what is held out of them or beside them."""
    from nico_selfmodel.dataset.body.body_folder import body_content_hash, load_body_dataset

    if test is not None and fraction is not None:
        raise ValueError("give --test or --test-fraction, not both")
    train = load_body_dataset(dataset)
    if fraction is not None:
        return train.split(fraction, seed)
    if test is None:
        return train, None
    held_out = load_body_dataset(test)
    inputs.refuse_training_data(test, body_content_hash(held_out), body_content_hash(train))
    return train, held_out.like(train)


def _with_boards(
    data: "BodyDataset", folder: Path, board: "AnyBoard", progress: "Progress"
) -> "BodyDataset":
    """Return a recording with the boards that its cameras photographed besides.

    They lie in a folder for each camera, or are called `left*` and `right*`.
    """
    from nico_selfmodel.dataset.body.boards import with_boards
    from nico_selfmodel.vision.boards.board_detections import (
        detect_boards,
        detect_boards_of_cameras,
    )
    from nico_selfmodel.vision.boards.board_images import images_by_folder

    inside = folder.is_dir() and any(path.is_dir() for path in folder.iterdir())
    if inside:
        found = detect_boards_of_cameras(images_by_folder(folder), board, progress=progress)
    else:
        found = detect_boards(folder, board, progress=progress)
    return with_boards(data, found.seen_views)


def _lenses(path: Path | None, data: "BodyDataset") -> "dict[str, Camera]":
    """Return the intrinsics of calibrated cameras, by name; refuse those of others alone."""
    from nico_selfmodel.dataset.body.sensors import CAMERA
    from nico_selfmodel.errors import DataError
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.names import listed

    if path is None:
        return {}
    lenses = dict(load_model(path).cameras)
    seeing = [sensor.name for sensor in data.sensors if sensor.kind == CAMERA]
    if not set(lenses) & set(seeing):
        raise DataError(
            f"--cameras {path} holds the cameras {listed(lenses) or 'none'}, data set "
            f"{data.name!r} has {listed(seeing) or 'none'}: they are matched by name"
        )
    return lenses


def _described(
    robot: str,
    data: "BodyDataset",
    lenses: "dict[str, Camera]",
    off: tuple[float, float] | None,
) -> "Description":
    """Return the robot as its description has it, and how far that is off where somebody said."""
    from nico_selfmodel.estimation.tree.boards.lenses_by_boards import lenses_by_boards
    from nico_selfmodel.estimation.tree.tree_setup import Description, blank_body
    from nico_selfmodel.plant.described_body import described_body, described_masses
    from nico_selfmodel.plant.robots import find_robot

    urdf = find_robot(robot)
    told = {**lenses_by_boards(data, lenses)[0], **lenses}
    body = described_body(urdf, data.joints, blank_body(data, told))
    found = Description(body, masses=described_masses(urdf, body))
    if off is None:
        return found
    return replace(found, turn_sigma=off[0], shift_sigma=off[1], learned=False)
