"""`nico-selfmodel calibrate hand-eye`: a sensor and the flange of an arm whose pose is read."""

from nico_selfmodel.cli import options
from nico_selfmodel.cli.calibrate import any_body


def hand_eye(
    dataset: options.Dataset,
    out: options.Out,
    test: options.Test = None,
    test_fraction: options.TestFraction = None,
    seed: options.SplitSeed = 0,
    fix: options.Fix = None,
    free: options.Free = None,
    prior: options.Prior = None,
    cameras: options.Cameras = None,
    name: options.ModelName = None,
    require_test_mm: options.RequireTestMm = None,
    require_test_px: options.RequireTestPx = None,
    no_report: options.NoReport = False,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Learn where a sensor and its target are from flange poses (AX = XB), with error bars.

    The data set has a joint with `motion: flange`, and a sensor that tells whole poses of a target.
    """
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.errors import DataError
    from nico_selfmodel.model.tree.body_tree import FLANGE

    joints = load_body_dataset(dataset).joints
    if not any(joint.motion == FLANGE for joint in joints):
        raise DataError(
            f"{dataset} has no joint with 'motion: flange', whose pose a controller tells; with "
            "encoders give it to `calibrate body`"
        )
    any_body.calibrate(
        dataset,
        out,
        test=test,
        test_fraction=test_fraction,
        seed=seed,
        fix=fix,
        free=free,
        prior=prior,
        robot=None,
        cameras=cameras,
        name=name,
        require_test_mm=require_test_mm,
        require_test_px=require_test_px,
        no_report=no_report,
        force=force,
        as_json=as_json,
    )
