"""`nico-selfmodel export-urdf`: the learned arm as a URDF."""

from nico_selfmodel.cli import options, printer


def export_urdf(model: options.Model, out: options.OutFile, force: options.Force = False) -> None:
    """Write the learned geometry as a URDF.

    It is the robot's own URDF, calibrated, where it is known. Links whose shape was learned
    (`body/` beside the self-model) get it as a mesh in a folder beside the URDF, and collide as
    capsules that were fitted to it.
    """
    from nico_selfmodel.files.whole import folder_in_place_of, refuse_existing, write_whole
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.shape.shape_folder import shape_beside
    from nico_selfmodel.plant import ArmDescription, learned_urdf
    from nico_selfmodel.plant.export.shape_urdf import ShapeInUrdf
    from nico_selfmodel.plant.export.urdf_export import masses_words

    refuse_existing(out, force=force, inputs=[model])
    learned, seen = load_model(model), shape_beside(model)
    robot = ArmDescription.of_model(learned)
    shape = None if seen is None else ShapeInUrdf.beside(out, seen)
    urdf = learned_urdf(learned, robot, out.parent, shape)
    if shape is not None:
        refuse_existing(out.parent / shape.folder, force=force)
        with folder_in_place_of(out.parent / shape.folder) as meshes:
            for name, text in shape.files.items():
                (meshes / name).write_text(text, encoding="utf-8", newline="\n")
    write_whole(out, urdf)
    printer.line(f"{out}\n{masses_words(learned, robot)}")
    if shape is not None:
        printer.line(f"learned shape in {shape.folder}/: {shape.words}")
