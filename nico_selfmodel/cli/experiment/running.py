"""What every experiment's command does: refuse, run, write, print."""

from typing import TYPE_CHECKING

from nico_selfmodel.cli import printer
from nico_selfmodel.cli.option_groups import Output

if TYPE_CHECKING:
    from nico_selfmodel.experiments.experiment_report import ExperimentReport
    from nico_selfmodel.systems.simulated.imperfections import Imperfections


def finish(report: "ExperimentReport", output: Output) -> None:
    """Write what an experiment found, and print its tables or its document."""
    report.write(output.out, force=output.force)
    if output.as_json:
        printer.as_json(report.document)
        return
    for table in report.tables:
        printer.table(table.title, table.headings, table.rows)
    printer.folder(output.out)


def imperfect(name: str, joint_noise_deg: float | None) -> "Imperfections":
    """Return the imperfections that options name.

    Raises:
        ValueError: If there are none of that name.
    """
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    return imperfections_named(name).with_noise(play_deg=joint_noise_deg)


def plausible_pixel_sigma(sigma: float) -> float:
    """Return the noise of a pixel coordinate, refused where it cannot be meant.

    Raises:
        ValueError: If it is 10 px or more.
    """
    if sigma >= 10.0:
        raise ValueError(f"--pixel-sigma must lie between 0 and 10 px, got {sigma}")
    return sigma
