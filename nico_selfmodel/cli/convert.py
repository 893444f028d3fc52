"""`nico-selfmodel convert`: a data set of one arm as a recording of any body."""

from nico_selfmodel.cli import options, printer


def convert(
    dataset: options.Dataset,
    out: options.Out,
    cameras: options.Cameras = None,
    force: options.Force = False,
) -> None:
    """Write a data set of one arm in the form of `calibrate body`.

    That is a recording of poses and observations. Joints, markers and sensors can then be added to
    `dataset.yaml`. What was seen in a mirror stays behind. Of --cameras it takes lenses, and how
    they stand to each other, which tells lengths.
    """
    from nico_selfmodel.dataset.body.body_folder import save_body_dataset
    from nico_selfmodel.dataset.body.conversion import body_dataset_of, with_poses_of
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.model.self_model_file import load_model

    refuse_existing(out, force=force, inputs=[dataset, cameras])
    known = None if cameras is None else load_model(cameras)
    lenses = None if known is None else {"left": known.rig.left, "right": known.rig.right}
    data = body_dataset_of(load_dataset(dataset), lenses)
    if known is not None:
        data = with_poses_of(data, known)
    save_body_dataset(data, out, force=force)
    printer.body_dataset(data, out)
