"""What commands that learn do with a recording of any body."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.option_groups import (
    Bends,
    Bounds,
    Fixed,
    HeldOut,
    NamedOutput,
    OptionGroup,
    Output,
)
from nico_selfmodel.cli.result_files import judge_and_write

if TYPE_CHECKING:
    from nico_selfmodel.dataset.body.body_dataset import BodyDataset
    from nico_selfmodel.estimation.monitoring.body_relearning import BodyUpdate
    from nico_selfmodel.estimation.tree.tree_calibration import TreeCalibration
    from nico_selfmodel.estimation.tree.tree_setup import Description, Wishes
    from nico_selfmodel.model.cameras.camera import Camera
    from nico_selfmodel.progress import Progress
    from nico_selfmodel.vision.boards.board_detection import AnyBoard
    from nico_selfmodel.viz.reports.page import Report

NOISE_IS_KNOWN = "a body knows the noise of its joints, and leaves out what contradicts it"
"""Why a command does not take how poses are weighed where its model is a body."""


@dataclass(frozen=True)
class Known(OptionGroup):
    """What is known of a body before it is learned."""

    cameras: options.Cameras = None
    prior: options.Prior = None


def calibrate(
    dataset: Path,
    output: NamedOutput,
    held_out: HeldOut,
    fixed: Fixed,
    known: Known,
    bounds: Bounds,
    *,
    bends: Bends | None = None,
    robot: str | None = None,
    robot_sigma: str | None = None,
    boards: Path | None = None,
    board: "AnyBoard | None" = None,
) -> NoReturn:
    """Learn a body from poses and observations, and leave a result folder."""
    from nico_selfmodel.estimation.bending.what_bends import effects_of, up_of
    from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters, priors_of
    from nico_selfmodel.estimation.tree.tree_calibration import calibrate_tree
    from nico_selfmodel.estimation.tree.tree_result import body_model
    from nico_selfmodel.estimation.tree.tree_setup import Wishes, robot_sigmas_of

    inputs_read = [dataset, held_out.test, robot, known.cameras, boards]
    output.refuse(*inputs_read)
    inputs.refuse_untested(bounds, held_out)
    pins = FixedParameters.from_text(fixed.fix or (), fixed.free or ())
    wishes = Wishes(pins, priors_of(known.prior or ()))
    off = None if robot_sigma is None else robot_sigmas_of(robot_sigma)
    if off is not None and robot is None:
        raise ValueError("--robot-sigma says how far a description may be off: give --robot too")
    bends = bends or Bends()
    may_bend, vertical = effects_of(bends.effects), up_of(bends.up)
    train, test = inputs.body_train_and_test(dataset, held_out)
    if robot is not None:
        train, test = _in_joint_frames(robot, train, test, wishes)
    lenses = _lenses(known.cameras, train)
    if known.cameras is not None and robot is None and boards is None:
        train = _with_poses(known.cameras, train)
    with printer.progress_bar() as progress:
        if boards is not None and board is not None:
            train = _with_boards(train, boards, board, progress)
        progress("learning", 0, 1)
        description = None if robot is None else _described(robot, train, lenses, off)
        found = calibrate_tree(
            train,
            test=test,
            description=description,
            lenses=lenses,
            wishes=wishes,
            name=output.name,
            seed=held_out.seed,
            effects=may_bend,
            up=vertical,
        )
        progress("learning", 1, 1)
        document = judge_and_write(
            found, body_model(found), drawn(found), output, progress, bounds=bounds
        )
    printer.result(found.name, document, output)


def calibrate_mirrors(
    dataset: Path,
    model: Path,
    output: Output,
    held_out: HeldOut,
    bounds: Bounds,
    *,
    name: str | None,
) -> NoReturn:
    """Learn mirrors in which a known body saw itself, and leave a result folder."""
    from nico_selfmodel.estimation.tree.mirrors.body_mirrors import calibrate_body_mirrors
    from nico_selfmodel.model.tree.body_model import load_body

    inputs.refuse_untested(bounds, held_out)
    body = load_body(model)
    train, test = inputs.body_train_and_test(dataset, held_out)
    with printer.progress_bar() as progress:
        progress("learning mirrors", 0, 1)
        learned = calibrate_body_mirrors(train, body, test=test, name=name)
        progress("learning mirrors", 1, 1)
        document = judge_and_write(
            learned.found, learned.model, drawn(learned.found), output, progress, bounds=bounds
        )
    printer.result(learned.model.name, document, output)


def rezero(model: Path, dataset: Path, output: Output, joints: list[str] | None) -> NoReturn:
    """Find the zeros of a body's encoders again, and leave a result folder."""
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.estimation.monitoring.body_relearning import rezero_body
    from nico_selfmodel.model.tree.body_model import load_body

    body, data = load_body(model), load_body_dataset(dataset)
    document = write_update(rezero_body(body, data, joints), output)
    printer.result(body.name, document, output)


def calibrate_tool(
    dataset: Path, model: Path, output: Output, held_out: HeldOut, tool: str | None
) -> NoReturn:
    """Learn where a tool's tip is on a body's link, and leave a result folder."""
    from nico_selfmodel.estimation.monitoring.body_relearning import calibrate_body_tool
    from nico_selfmodel.model.tree.body_model import load_body

    body = load_body(model)
    train, test = inputs.body_train_and_test(dataset, held_out)
    update = calibrate_body_tool(body, train, tool=tool, test=test)
    document = write_update(update, output)
    printer.result(body.name, document, output)


def write_update(update: "BodyUpdate", output: Output) -> dict[str, Any]:
    """Write what was learned anew of a body, with its report; return its `result.json`."""
    return judge_and_write(update, update.model, drawn(update.found), output)


def drawn(found: "TreeCalibration") -> "Callable[[dict[str, Any]], Report]":
    """Return what draws the report of a body."""

    def draw(document: dict[str, Any]) -> "Report":
        from nico_selfmodel.viz.reports.tree import tree_report  # slow to load

        return tree_report(found, document)

    return draw


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
    return with_boards(data, found.told_views)


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
            f"--cameras {path} has the cameras: {listed(lenses) or 'none'}; data set "
            f"{data.name!r}: {listed(seeing) or 'none'}: they are matched by name"
        )
    return lenses


def _with_poses(path: Path, data: "BodyDataset") -> "BodyDataset":
    """Return a recording that says how calibrated cameras stand to each other."""
    from nico_selfmodel.dataset.body.conversion import with_poses_of
    from nico_selfmodel.model.self_model_file import load_model

    return with_poses_of(data, load_model(path))


def _in_joint_frames(
    robot: str, train: "BodyDataset", test: "BodyDataset | None", wishes: "Wishes"
) -> "tuple[BodyDataset, BodyDataset | None]":
    """Return recordings with places on links, which are told in the frames of a description."""
    from nico_selfmodel.plant.described_links import (
        in_joint_frames,
        refuse_parts_on_turned,
        turned_links,
    )
    from nico_selfmodel.plant.robots import find_robot

    turned = turned_links(find_robot(robot), train.joints)
    values = [name for name, value in wishes.pins.pinned.items() if value is not None]
    refuse_parts_on_turned(train, turned, {*values, *wishes.priors})
    return in_joint_frames(train, turned), test and in_joint_frames(test, turned)


def _described(
    robot: str,
    data: "BodyDataset",
    lenses: "dict[str, Camera]",
    off: tuple[float, float] | None,
) -> "Description":
    """Return the robot as its description has it, and how far that is off where somebody said."""
    import numpy as np

    from nico_selfmodel.dataset.plausibility import check_spread
    from nico_selfmodel.estimation.tree.boards.lenses_by_boards import lenses_by_boards
    from nico_selfmodel.estimation.tree.tree_setup import Description, blank_body
    from nico_selfmodel.plant.described_body import described_body, described_masses
    from nico_selfmodel.plant.robots import find_robot

    urdf = find_robot(robot)
    told = {**lenses_by_boards(data, lenses)[0], **lenses}
    body = described_body(urdf, data.joints, blank_body(data, told))
    reach = float(np.linalg.norm(body.X_PJ[:, :3, 3], axis=1).sum())
    check_spread(f"--robot {robot}: from joint to joint it is", reach, "Origins of joints are")
    found = Description(body, masses=described_masses(urdf, body))
    if off is None:
        return found
    return replace(found, turn_sigma=off[0], shift_sigma=off[1], learned=False)
