"""What `calibrate kinematics` does with a data set: one, or each of many."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import inputs, options
from nico_selfmodel.cli.option_groups import (
    Bends,
    Bounds,
    Chain,
    Fixed,
    HeldOut,
    NamedOutput,
    OptionGroup,
)
from nico_selfmodel.cli.result_files import judge_and_write
from nico_selfmodel.progress import Progress

if TYPE_CHECKING:
    from nico_selfmodel.viz.reports.page import Report


@dataclass(frozen=True)
class Search(OptionGroup):
    """How an arm is searched for."""

    method: Annotated[
        str, typer.Option("--method", help="refine, or circle-points for the sweeps alone.")
    ] = "refine"
    loss: options.Loss = "trimmed"
    starts: Annotated[
        int, typer.Option("--starts", min=0, max=1_000_000, help="Random starts allowed.")
    ] = 10
    cameras: options.Cameras = None


@dataclass(frozen=True)
class ArmTask:
    """The options of the command, as they were given."""

    held_out: HeldOut
    search: Search
    fixed: Fixed
    bends: Bends
    chain: Chain
    bounds: Bounds
    command: str
    """The command line, for `result.json`."""
    output: NamedOutput

    def run(
        self, dataset: Path, output: NamedOutput, progress: Progress
    ) -> tuple[str, dict[str, Any]]:
        """Learn an arm and write its result folder.

        Returns:
            Name of the self-model, and what is in its `result.json`.
        """
        from nico_selfmodel.estimation.arm.arm_result import arm_result
        from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
        from nico_selfmodel.estimation.bending.what_bends import effects_of, up_of
        from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
        from nico_selfmodel.model.self_model_file import load_model

        pins = FixedParameters.from_text(self.fixed.fix or (), self.fixed.free or ())
        effects, up = effects_of(self.bends.effects), up_of(self.bends.up)
        train, test = inputs.train_and_test(dataset, self.held_out)
        stereo = None
        if self.search.cameras is not None:
            from nico_selfmodel.estimation.body.stereo_points import StereoPoints

            known = load_model(self.search.cameras)
            stereo = StereoPoints.of(known, train, test, frozenset(pins.pinned))
            train, test = stereo.train, stereo.test
        description, nominal = inputs.described_arm(self.chain)
        inputs.check_points(self.chain.point, train.markers)
        progress("learning", 0, 1)
        calibration = calibrate_kinematics(
            train,
            method=self.search.method,
            test=test,
            nominal=nominal,
            pins=pins,
            loss=self.search.loss,
            starts=self.search.starts,
            seed=self.held_out.seed,
            name=output.name,
            effects=effects,
            up=up,
            spread=None if stereo is None else stereo.spread,
        )
        if stereo is not None:
            calibration = stereo.complete(calibration)
        progress("learning", 1, 1)
        result = arm_result(calibration)
        if stereo is not None:
            result = stereo.with_pixels(result, calibration.model)

        def draw(document: dict[str, Any]) -> "Report":
            from nico_selfmodel.viz.reports.arm import arm_report  # slow to load

            return arm_report(calibration, document, description)

        document = judge_and_write(
            result,
            calibration.model,
            draw,
            output,
            progress,
            bounds=self.bounds,
            command=self.command,
            robot=description,
        )
        return calibration.model.name, document
