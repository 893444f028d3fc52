"""`nico-selfmodel calibrate servos`: how joints follow their commands."""

from typing import TYPE_CHECKING, Any

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli.result_files import judge_and_write

if TYPE_CHECKING:
    from nico_selfmodel.viz.reports.page import Report


def servos(dataset: options.Dataset, output: groups.NamedOutput, held_out: groups.HeldOut) -> None:
    """Learn how joints follow their commands, by steps.

    Delay, largest speed, acceleration and rate of each joint, with error bars. The data set is a
    recording of steps, as `servo steps` makes one.
    """
    from nico_selfmodel.estimation.response.servo_calibration import calibrate_servos

    output.refuse(dataset, held_out.test)
    train, test = inputs.steps_and_test(dataset, held_out)
    share, seed = held_out.test_fraction or 0.0, held_out.seed
    found = calibrate_servos(train, test, fraction=share, seed=seed, name=output.name)

    def draw(document: dict[str, Any]) -> "Report":
        from nico_selfmodel.viz.reports.responses import servo_report  # slow to load

        return servo_report(found, document)

    document = judge_and_write(found, found.model, draw, output)
    printer.result(found.model.name, document, output)
