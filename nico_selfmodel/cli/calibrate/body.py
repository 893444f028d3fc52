"""`nico-selfmodel calibrate body`: arm and cameras together."""

from pathlib import Path

import typer

from nico_selfmodel.cli import inputs, options
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.calibrate import any_body, arm_and_cameras

_OF_TWO_CAMERAS = (
    "model", "board_test_fraction", "stage", "variant", "loss",
    "arm", "base", "tip", "hold", "point",
)  # fmt: skip
"""Options for an arm and two cameras."""
_OF_ANY_BODY = ("cameras", "prior", "robot_sigma")


def body(
    context: typer.Context,
    dataset: options.Dataset,
    output: groups.NamedOutput,
    held_out: groups.HeldOut,
    fixed: groups.Fixed,
    known: any_body.Known,
    bounds: groups.Bounds,
    bends: groups.Bends,
    chain: groups.Chain,
    boards: arm_and_cameras.Boards,
    choices: arm_and_cameras.Choices,
    robot_sigma: options.RobotSigma = None,
) -> None:
    """Learn a body from all that was seen of it.

    A data set with `poses.csv` and `observations.csv` is of any body and any sensors, and needs
    nothing else; --boards tell lenses that it does not, and where cameras stand. One with
    `samples.csv` is of an arm and two cameras, which refine each other (thesis chapter 8): its
    --model has both cameras, and the arm if it is known.
    """
    any_tree = _is_any_body(context, dataset)
    board = boards.load()
    if any_tree:
        any_body.calibrate(
            dataset,
            output,
            held_out,
            fixed,
            known,
            bounds,
            bends=bends,
            robot=chain.robot,
            robot_sigma=robot_sigma,
            boards=boards.boards,
            board=board,
        )
    nominal = inputs.described_arm(chain)[1]
    arm_and_cameras.calibrate(
        dataset,
        output,
        held_out,
        fixed,
        bounds,
        bends,
        boards,
        board,
        choices,
        chain.robot,
        nominal,
    )


def _is_any_body(context: typer.Context, dataset: Path) -> bool:
    """Return whether a data set is of any body; refuse options that its form does not use."""
    from nico_selfmodel.dataset.body.body_folder import is_body_dataset

    found = is_body_dataset(dataset)
    if found:
        why = f"{dataset} is of any body; such options are for an arm and two cameras"
    else:
        why = f"{dataset} is of an arm and two cameras; such options are for any body"
    options.refuse_given(context, _OF_TWO_CAMERAS if found else _OF_ANY_BODY, why)
    return found
