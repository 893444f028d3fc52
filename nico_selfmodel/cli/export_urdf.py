"""`nico-selfmodel export-urdf`: the learned arm as a URDF."""

from nico_selfmodel.cli import options, printer


def export_urdf(model: options.Model, out: options.OutFile, force: options.Force = False) -> None:
    """Write the learned geometry as a URDF; the robot's own, calibrated, where it is known."""
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.plant import ArmDescription, learned_urdf

    refuse_existing(out, force=force)
    learned = load_model(model)
    text = learned_urdf(learned, ArmDescription.of_model(learned), folder=out.parent)
    write_whole(out, text)
    printer.line(f"{out}")
