"""`nico-selfmodel calibrate hand-eye`: a sensor and the flange of an arm whose pose is read."""

from nico_selfmodel.cli import option_groups as groups
from nico_selfmodel.cli import options
from nico_selfmodel.cli.calibrate import any_body


def hand_eye(
    dataset: options.Dataset,
    output: groups.NamedOutput,
    held_out: groups.HeldOut,
    fixed: groups.Fixed,
    known: any_body.Known,
    bounds: groups.Bounds,
) -> None:
    """Learn where a sensor is from flange poses (AX = XB).

    Where its target is comes with it, both with error bars. The data set has a joint with `motion:
    flange`, and a sensor that tells whole poses of a target, or a camera on the flange that sees
    corners at known places.
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
    any_body.calibrate(dataset, output, held_out, fixed, known, bounds)
