"""`nico-selfmodel view`: a result in Meshcat."""

import threading
from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console


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
    html: Annotated[
        Path | None, typer.Option("--html", help="Write the scene as one HTML file and return.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Show a result in Meshcat, on localhost, until Ctrl-C."""
    from nico_selfmodel.files import refuse_existing, write_whole
    from nico_selfmodel.viz.drake_backend import draw_in_drake, static_html
    from nico_selfmodel.viz.meshcat_backend import publish
    from nico_selfmodel.viz.scene import load_scene

    scene = load_scene(result)
    if html is not None:
        refuse_existing(html, force=force)
        write_whole(html, static_html(scene))
        console.out.print(f"{html}", markup=False)
        return
    if server is not None:
        url = publish(scene, server)
        console.out.print(f"published; open {url}", markup=False)
        return
    meshcat = draw_in_drake(scene)
    console.out.print(f"open {meshcat.web_url()} (Ctrl-C ends)", markup=False)
    threading.Event().wait()
