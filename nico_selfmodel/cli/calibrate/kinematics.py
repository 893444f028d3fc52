"""`nico-selfmodel calibrate kinematics`: learn an arm."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.calibrate.arm_task import ArmTask
from nico_selfmodel.cli.result_files import command_line


def kinematics(
    dataset: options.Datasets,
    out: options.Out,
    test: options.Test = None,
    test_fraction: options.TestFraction = None,
    seed: options.SplitSeed = 0,
    method: Annotated[
        str, typer.Option("--method", help="refine, or circle-points for the sweeps alone.")
    ] = "refine",
    fix: options.Fix = None,
    free: options.Free = None,
    loss: options.Loss = "trimmed",
    effects: options.Effects = "auto",
    up: options.Up = None,
    starts: Annotated[
        int, typer.Option("--starts", min=0, max=1_000_000, help="Random starts allowed.")
    ] = 10,
    robot: options.Robot = None,
    arm: options.Arm = None,
    base: options.Base = None,
    tip: options.Tip = None,
    hold: options.Hold = None,
    point: options.Point = None,
    cameras: options.Cameras = None,
    name: options.ModelName = None,
    require_test_mm: options.RequireTestMm = None,
    processes: options.Processes = 1,
    dask: options.Dask = None,
    no_report: options.NoReport = False,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn an arm from encoder readings and measured points of the hand.

    With --cameras it learns from the hand's pixels, in the left camera's frame. Of several data
    sets, or of folders that hold some, it makes one folder with a result for each and one table; a
    robot a folder is many robots at once.
    """
    from nico_selfmodel.files.whole import refuse_folder

    refuse_folder(out, force=force, inputs=[*dataset, test, robot, cameras])
    inputs.refuse_untested(require_test_mm, None, test, test_fraction)
    task = ArmTask(
        *(test, test_fraction, seed, method, fix, free, loss, starts),
        *(
            robot,
            arm,
            base,
            tip,
            hold,
            point,
            cameras,
            name,
            require_test_mm,
            command_line(),
            no_report,
            effects,
            up,
        ),
    )
    if len(dataset) == 1 and not _holds_data_sets(dataset[0]):
        with printer.progress_bar() as progress:
            known_as, document = task.run(dataset[0], out, progress, force=force)
        printer.result(known_as, document, out, json_instead=as_json)
    if test is not None or name is not None:
        raise ValueError("--test and --name are for one data set: take --test-fraction for many")
    from nico_selfmodel.cli.calibrate.many import calibrate_many, recordings_in
    from nico_selfmodel.parallel import Workers

    recordings, workers = recordings_in(dataset), Workers(processes, dask)
    calibrate_many(recordings, task, workers, out, force=force, as_json=as_json)


def _holds_data_sets(folder: Path) -> bool:
    """Whether a folder is no data set, but has some in it."""
    if (folder / "dataset.yaml").exists() or (folder / "samples.csv").exists():
        return False
    return next(folder.rglob("samples.csv"), None) is not None
