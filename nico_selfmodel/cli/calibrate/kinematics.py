"""`nico-selfmodel calibrate kinematics`: learn an arm."""

from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli.result_files import stamped, write_with_report


def kinematics(
    dataset: options.Dataset,
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
    starts: Annotated[int, typer.Option("--starts", min=0, help="Random starts allowed.")] = 10,
    robot: options.Robot = None,
    arm: options.Arm = None,
    base: options.Base = None,
    tip: options.Tip = None,
    hold: options.Hold = None,
    point: options.Point = None,
    cameras: options.Cameras = None,
    name: options.ModelName = None,
    require_test_mm: options.RequireTestMm = None,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn an arm from encoder readings and measured points of the hand.

    With --cameras it learns from the hand's pixels, in the left camera's frame.
    """
    from nico_selfmodel.estimation.arm.kinematics import calibrate_kinematics
    from nico_selfmodel.estimation.body.stereo_points import StereoPoints
    from nico_selfmodel.estimation.judging import judge, result_of, to_json
    from nico_selfmodel.estimation.results.fixed_parameters import FixedParameters
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.model.self_model_file import load_model

    refuse_folder(out, force=force, inputs=[dataset, test, robot, cameras])
    pins = FixedParameters.from_text(fix or (), free or ())
    train, held_out = inputs.train_and_test(dataset, test, test_fraction, seed)
    stereo = None
    if cameras is not None:
        stereo = StereoPoints.of(load_model(cameras), train, held_out, frozenset(pins.pinned))
        train, held_out = stereo.train, stereo.test
    description, nominal = inputs.described_arm(robot, arm, base, tip, hold, point)
    inputs.check_points(point, train.markers)
    with printer.progress_bar() as progress:
        progress("learning", 0, 1)
        calibration = calibrate_kinematics(
            train,
            method=method,
            test=held_out,
            nominal=nominal,
            pins=pins,
            loss=loss,
            starts=starts,
            seed=seed,
            name=name,
        )
        if stereo is not None:
            calibration = stereo.complete(calibration)
        progress("learning", 1, 1)
        result = result_of(calibration)
        if stereo is not None:
            result = stereo.with_pixels(result, calibration.model)
        document = stamped(to_json(result, judge(result, require_test_mm)))
        progress("writing the result", 0, 1)
        # Drawing is slow to load, and only needed once there is something to draw.
        from nico_selfmodel.viz.reports.arm import arm_report

        report = arm_report(calibration, document, description)
        write_with_report(out, calibration.model, report, robot=description, force=force)
        progress("writing the result", 1, 1)
    printer.result(calibration.model.name, document, out, json_instead=as_json)
