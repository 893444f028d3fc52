"""What `calibrate kinematics` does with a data set: one, or each of many."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nico_selfmodel.cli import inputs
from nico_selfmodel.cli.result_files import NoReport, stamped, write_with_report
from nico_selfmodel.progress import Progress


@dataclass(frozen=True)
class ArmTask:
    """The options of the command, as they were given."""

    test: Path | None
    test_fraction: float | None
    seed: int
    method: str
    fix: list[str] | None
    free: list[str] | None
    loss: str
    starts: int
    robot: str | None
    arm: str | None
    base: str | None
    tip: str | None
    hold: list[str] | None
    point: list[str] | None
    cameras: Path | None
    name: str | None
    require_test_mm: float | None
    command: str
    """The command line, for `result.json`."""
    no_report: bool = False
    effects: str = "auto"
    up: str | None = None

    def run(
        self, dataset: Path, out: Path, progress: Progress, *, force: bool = False
    ) -> tuple[str, dict[str, Any]]:
        """Learn an arm and write its result folder.

        Args:
            dataset: Folder of the data set.
            out: The folder to make.
            progress: Told how far it is.
            force: Replace an existing folder.

        Returns:
            Name of the self-model, and what is in its `result.json`.
        """
        from nico_selfmodel.estimation.arm.arm_result import arm_result
        from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
        from nico_selfmodel.estimation.bending.what_bends import effects_of, up_of
        from nico_selfmodel.estimation.results.document import document_of
        from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
        from nico_selfmodel.estimation.results.judge import verdict_on
        from nico_selfmodel.model.self_model_file import load_model

        pins = FixedParameters.from_text(self.fix or (), self.free or ())
        effects, up = effects_of(self.effects), up_of(self.up)
        train, held_out = inputs.train_and_test(dataset, self.test, self.test_fraction, self.seed)
        stereo = None
        if self.cameras is not None:
            from nico_selfmodel.estimation.body.stereo_points import StereoPoints

            known = load_model(self.cameras)
            stereo = StereoPoints.of(known, train, held_out, frozenset(pins.pinned))
            train, held_out = stereo.train, stereo.test
        description, nominal = inputs.described_arm(
            self.robot, self.arm, self.base, self.tip, self.hold, self.point
        )
        inputs.check_points(self.point, train.markers)
        progress("learning", 0, 1)
        calibration = calibrate_kinematics(
            train,
            method=self.method,
            test=held_out,
            nominal=nominal,
            pins=pins,
            loss=self.loss,
            starts=self.starts,
            seed=self.seed,
            name=self.name,
            effects=effects,
            up=up,
        )
        if stereo is not None:
            calibration = stereo.complete(calibration)
        progress("learning", 1, 1)
        result = arm_result(calibration)
        if stereo is not None:
            result = stereo.with_pixels(result, calibration.model)
        document = stamped(
            document_of(result, verdict_on(result, self.require_test_mm)), command=self.command
        )
        progress("writing the result", 0, 1)
        report = NoReport(document)
        if not self.no_report:
            # Drawing is slow to load, and only needed once there is something to draw.
            from nico_selfmodel.viz.reports.arm import arm_report

            report = arm_report(calibration, document, description)
        write_with_report(out, calibration.model, report, robot=description, force=force)
        progress("writing the result", 1, 1)
        return calibration.model.name, document
