"""`nico-selfmodel view`: a result in Meshcat."""

import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer

if TYPE_CHECKING:
    from nico_selfmodel.viz.scene.scene import Scene


def view(
    result: Annotated[Path, typer.Argument(help="A result folder.")],
    server: Annotated[
        str | None,
        typer.Option(
            "--server",
            metavar="URL",
            help="Publish to a running meshcat-server (tcp://127.0.0.1:6000) and return.",
        ),
    ] = None,
    out: options.OutPage = None,
    force: options.Force = False,
) -> None:
    """Show a result in Meshcat, on localhost, until Ctrl-C.

    Links whose shape was learned (`body/` in the folder) stand as they were seen, in the colours
    seen; what was never seen of them is grey.
    """
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.viz.live.drake_backend import draw_in_drake
    from nico_selfmodel.viz.live.meshcat_backend import publish
    from nico_selfmodel.viz.live.static_page import static_html

    scene = _scene_with_shape(result)
    if out is not None:
        refuse_existing(out, force=force, inputs=[result])
        write_whole(out, static_html(scene))
        printer.line(f"{out}")
        return
    if server is not None:
        printer.line(f"published; open {publish(scene, server)}")
        return
    meshcat = draw_in_drake(scene)
    printer.line(f"open {meshcat.web_url()} (Ctrl-C ends)")
    threading.Event().wait()


def _scene_with_shape(result: Path) -> "Scene":
    """Return the scene of a result, with the learned shape where there is one."""
    from nico_selfmodel.model.shape.shape_folder import shape_beside
    from nico_selfmodel.viz.scene.scene import load_scene

    scene, shape = load_scene(result), shape_beside(result)
    if shape is None:
        return scene
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.viz.scene.robot.shape_items import with_shape
    from nico_selfmodel.viz.scene.surroundings import upright

    model = load_model(result if result.is_dir() else result.parent)
    return with_shape(scene, shape, upright(model, ArmDescription.of_model(model)))
