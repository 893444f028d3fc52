"""`nico-selfmodel look`: pictures of one's own in mirrors, seen, expected, and what surprises."""

from pathlib import Path
from typing import Annotated, Any

import typer

from nico_selfmodel.cli import options, printer


def look(
    model: options.Model,
    pictures: Annotated[
        Path, typer.Argument(help="Recording before mirrors that kept its pictures (--images).")
    ],
    out: options.Out,
    most: Annotated[
        int, typer.Option("--most", min=2, help="Poses before each mirror that are looked at.")
    ] = 3,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Find what surprises in pictures of the body in mirrors.

    They are held against what was expected. The model knows arm, cameras, mirrors and its robot's
    description, the recording says where the arm was and which mirror stood there. Writes, for each
    pose, what both cameras saw, what was expected and what differs, and a table of the places that
    surprise. The moving arm is not judged.
    """
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.files.whole import refuse_folder
    from nico_selfmodel.model.self_model_file import load_model

    refuse_folder(out, force=force, inputs=[model, pictures])
    body, data = load_model(model), load_dataset(pictures)
    # The renderer is slow to load.
    from nico_selfmodel.sessions.mirrors.own_pictures import look_at_own_pictures
    from nico_selfmodel.sessions.mirrors.own_pictures_folder import write_looks

    with printer.progress_bar() as progress:
        looks = look_at_own_pictures(
            body, data, pictures, most, lambda done, of: progress("looking", done, of)
        )
        document = write_looks(out, looks, force=force)
    if as_json:
        printer.as_json(document)
        return
    headings = ("sample", "mirror", "camera", "judged px", "mean z²", "surprising")
    cells = [_cells(row, camera) for row in document["looks"] for camera in row["cameras"]]
    printer.table("the body in mirrors", headings, cells)
    printer.line(f"{document['surprising']} places surprise: {out}/result.json and drawings")


def _cells(row: dict[str, Any], camera: dict[str, Any]) -> list[str]:
    links = [place["link"] for place in camera["places"]]
    told = f"{len(links)}: {', '.join(dict.fromkeys(links))}" if links else "0"
    return [
        str(row["sample"]),
        row["mirror"],
        camera["camera"],
        str(camera["judged_px"]),
        f"{camera['mean_chi_square']:.1f}",
        told,
    ]
