"""`nico-selfmodel calibrate kinematics`: learn an arm."""

from pathlib import Path

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.calibrate.arm_task import ArmTask, Search
from nico_selfmodel.cli.result_files import command_line
from nico_selfmodel.files.whole import RESULT_FILE


def kinematics(
    dataset: options.Datasets,
    output: groups.NamedOutput,
    held_out: groups.HeldOut,
    search: Search,
    fixed: groups.Fixed,
    bends: groups.Bends,
    chain: groups.Chain,
    require_test_mm: options.RequireTestMm = None,
    processes: options.Processes = 1,
    dask: options.Dask = None,
) -> None:
    """Learn an arm from encoder readings and points of the hand.

    The points are those that motion capture measured. With --cameras it learns from the hand's
    pixels, in the left camera's frame. Of several data sets, or of folders that hold some, it makes
    one folder with a result for each and one table; a robot a folder is many robots at once.
    """
    output.refuse(*dataset, held_out.test, chain.robot, search.cameras)
    bounds = groups.Bounds(require_test_mm)
    inputs.refuse_untested(bounds, held_out)
    task = ArmTask(held_out, search, fixed, bends, chain, bounds, command_line(), output)
    if len(dataset) == 1 and not _holds_data_sets(dataset[0]):
        if dask is not None:
            raise ValueError("--dask is for many data sets, got one: leave it out")
        with printer.progress_bar() as progress:
            known_as, document = task.run(dataset[0], output, progress)
        printer.result(known_as, document, output)
    if held_out.test is not None or output.name is not None:
        raise ValueError("--test and --name are for one data set: take --test-fraction for many")
    from nico_selfmodel.cli.calibrate.many import calibrate_many, recordings_in
    from nico_selfmodel.parallel import Workers

    calibrate_many(recordings_in(dataset), task, Workers(processes, dask))


def _holds_data_sets(folder: Path) -> bool:
    """Whether a folder is no data set, but has some in it."""
    if any((folder / name).exists() for name in ("dataset.yaml", "samples.csv", RESULT_FILE)):
        return False
    return next(folder.rglob("samples.csv"), None) is not None
