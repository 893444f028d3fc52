"""`nico-selfmodel gaze`: where to turn the head to look at a point, or at the own hand."""

from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.names import listed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.model.tree.body_model import BodyModel


def gaze(
    model: options.Model,
    encoders: Annotated[
        str | None,
        typer.Option("--encoders", metavar="A,B,...", help="Readings now, in the joints' order."),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option("--target", metavar="X,Y,Z", help="A point in the body's frame W [m]."),
    ] = None,
    marker: options.Marker = None,
    camera: Annotated[
        list[str] | None,
        typer.Option("--camera", help="Camera that shall look; all that the head carries."),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Turn the head so that a point, or a marker on the own hand, comes to the images' middle."""
    from nico_selfmodel.model.tree.body_model import is_body, load_body
    from nico_selfmodel.plant.gaze import GazeSolver

    if not is_body(model):
        raise ValueError(
            f"{model} is no body whose head turns: give the folder that `learn --head` left, or "
            "`calibrate body` of a recording with poses.csv"
        )
    body = load_body(model)
    if encoders is None or (target is None) == (marker is None):
        raise ValueError(
            f"give --encoders and either --target or --marker; the joints are "
            f"{listed(body.tree.joints)}"
        )
    solver, now = GazeSolver(body, camera or ()), _readings(body, encoders)
    if marker is not None:
        found = solver.at_marker(now, marker)
    else:
        found = solver.at_point(now, _point(target or ""))
    turned = dict(zip(solver.joints, found.readings[solver.head].tolist(), strict=True))
    if as_json:
        seen = {name: uv.tolist() for name, uv in found.pixels.items()}
        off = {"off_px": found.off_px, "misaligned_px": found.misaligned_px}
        printer.as_json({"readings": turned, "pixels": seen} | off)
        return
    for name, reading in turned.items():
        printer.line(f"{name:24} {reading:.6g}")
    for name, (u, v) in found.pixels.items():
        printer.line(f"{name:24} sees it at {u:.1f}, {v:.1f} px")
    if found.misaligned_px:
        printer.line(f"{found.misaligned_px:.0f} px are how the cameras stand to each other")


def _readings(body: "BodyModel", encoders: str) -> "NDArray":
    """Return readings of all joints, nan where one has no encoder. Shape (n,)."""
    import numpy as np

    from nico_selfmodel.model.readings import readings_from_words

    tree = body.tree
    read = [i for i in range(len(tree.joints)) if tree.coupling[i, i]]
    out = np.full(len(tree.joints), np.nan)
    out[read] = readings_from_words([encoders], tuple(tree.joints[i] for i in read))[0]
    return out


def _point(text: str) -> "NDArray":
    import numpy as np

    from nico_selfmodel.files.csv_rows import number_of_word

    words = text.split(",")
    if len(words) != 3:
        raise ValueError(f"--target must be X,Y,Z [m], got {text}")
    return np.array([number_of_word(word, "--target") for word in words])
