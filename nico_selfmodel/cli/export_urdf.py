"""`nico-selfmodel export-urdf`: the learned arm as a URDF."""

from nico_selfmodel.cli import options, printer


def export_urdf(model: options.Model, out: options.OutFile, force: options.Force = False) -> None:
    """Write the learned geometry as a URDF; the robot's own, calibrated, where it is known."""
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.plant import ArmDescription, learned_urdf
    from nico_selfmodel.plant.urdf_export import masses_words

    refuse_existing(out, force=force)
    learned = load_model(model)
    robot = ArmDescription.of_model(learned)
    write_whole(out, learned_urdf(learned, robot, folder=out.parent))
    printer.line(f"{out}\n{masses_words(learned, robot)}")
