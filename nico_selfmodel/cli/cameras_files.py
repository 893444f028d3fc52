"""`nico-selfmodel export cameras` and `import cameras`: the files of other programs."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer


def export_cameras(
    model: options.Model,
    out: options.Out,
    format: Annotated[
        str, typer.Option("--format", help="opencv, opencv-json, ros, kalibr or mrcal.")
    ] = "opencv",
    force: options.Force = False,
) -> None:
    """Write cameras for OpenCV, ROS, Kalibr or mrcal.

    ROS and mrcal have a file for each camera.
    """
    from nico_selfmodel.files.whole import folder_written_whole, refuse_folder
    from nico_selfmodel.model.camera_formats.formats import camera_texts
    from nico_selfmodel.model.camera_formats.ros_format import rectified_pair
    from nico_selfmodel.model.self_model_file import load_model

    refuse_folder(out, force=force, inputs=[model])
    cameras = load_model(model).cameras
    texts = camera_texts(cameras, format)
    with folder_written_whole(out, force=force) as folder:
        for name, text in texts.items():
            (folder / name).write_text(text, encoding="utf-8")
    printer.line("\n".join(str(out / name) for name in texts))
    if format == "ros" and len(cameras) > 1 and not rectified_pair(cameras):
        printer.line(
            "files of ROS tell how a pair stands that can be rectified, not how these cameras do; "
            "see --format kalibr"
        )


def import_cameras(
    files: Annotated[
        list[Path], typer.Argument(help="The file; or one for each camera, the left one's first.")
    ],
    out: options.Out,
    force: options.Force = False,
) -> None:
    """Import cameras that OpenCV, ROS, Kalibr or mrcal calibrated."""
    from nico_selfmodel.files.whole import folder_written_whole, refuse_folder
    from nico_selfmodel.model.camera_formats.formats import read_cameras
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.model.self_model_file import save_model

    refuse_folder(out, force=force, inputs=files)
    cameras = read_cameras(files)
    names = ", ".join(path.name for path in files)
    model = SelfModel(inputs.name_after(out), cameras=cameras, provenance={"imported": names})
    with folder_written_whole(out, force=force) as folder:
        save_model(model, folder / "self_model.yaml")
    kinds = ", ".join(f"{side}: {camera.lens}" for side, camera in cameras.items())
    printer.line(f"{out} ({kinds})")
