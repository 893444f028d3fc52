"""`nico-selfmodel view`: a result in Meshcat."""

import threading
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer


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
    """Show a result in Meshcat, on localhost, until Ctrl-C."""
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.viz.live.drake_backend import draw_in_drake, static_html
    from nico_selfmodel.viz.live.meshcat_backend import publish
    from nico_selfmodel.viz.scene.scene import load_scene

    scene = load_scene(result)
    if out is not None:
        refuse_existing(out, force=force)
        write_whole(out, static_html(scene))
        printer.line(f"{out}")
        return
    if server is not None:
        printer.line(f"published; open {publish(scene, server)}")
        return
    meshcat = draw_in_drake(scene)
    printer.line(f"open {meshcat.web_url()} (Ctrl-C ends)")
    threading.Event().wait()
