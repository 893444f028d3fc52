"""`nico-selfmodel gaze`: where to turn the head to look at a point, or at the own hand."""

from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.inputs import name_and_value
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
    seen: Annotated[
        list[str] | None,
        typer.Option(
            "--seen", metavar="CAMERA=U,V", help="Where a camera sees it at --encoders [px]."
        ),
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Say where to turn the head to look at a point or at a hand.

    Then it is in the images' middle. Told where its cameras see the point now (`--seen`), the head
    turns to where it is seen.
    """
    import numpy as np

    from nico_selfmodel.model.tree.body_model import is_body, load_body
    from nico_selfmodel.plant.looking.gaze import GazeSolver

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
    place = _point(target) if target is not None else solver.place_of(now, marker or "")
    told = solver.again(now, place, _seen(seen))
    found = solver.at_point(now, place + told.offset)
    turned = dict(zip(solver.joints, found.readings[solver.head].tolist(), strict=True))
    if as_json:
        pixels = {name: uv.tolist() for name, uv in found.pixels.items()}
        off = {"off_px": found.off_px, "misaligned_px": found.misaligned_px}
        off |= {"offset_m": told.offset.tolist()} if told.looks else {}
        printer.as_json({"readings": turned, "pixels": pixels} | off)
        return
    for name, reading in turned.items():
        printer.line(f"{name:24} {reading:.6g}")
    for name, (u, v) in found.pixels.items():
        printer.line(f"{name:24} sees it at {u:.1f}, {v:.1f} px")
    if told.looks:
        away = 1000 * float(np.linalg.norm(told.offset))
        printer.line(f"it was seen {away:.1f} mm from where the body expects it")
    if found.misaligned_px > 1.0:
        printer.line(f"{found.misaligned_px:.0f} px are how the cameras stand to each other")


def _readings(body: "BodyModel", encoders: str) -> "NDArray":
    """Return readings of all joints, nan where one has no encoder. Shape (n,)."""
    import numpy as np

    from nico_selfmodel.dataset.readings import readings_from_words

    tree = body.tree
    read = [i for i in range(len(tree.joints)) if tree.coupling[i, i]]
    out = np.full(len(tree.joints), np.nan)
    out[read] = readings_from_words([encoders], tuple(tree.joints[i] for i in read))[0]
    return out


def _point(text: str) -> "NDArray":
    return _numbers(text, 3, "--target", "X,Y,Z [m]")


def _seen(words: list[str] | None) -> "dict[str, NDArray]":
    """Return where each camera sees the point [px]. Shape (2,) each."""
    named = [name_and_value(word, "--seen") for word in words or []]
    return {name: _numbers(uv, 2, f"--seen {name}", "U,V [px]") for name, uv in named}


def _numbers(text: str, count: int, option: str, expected: str) -> "NDArray":
    import numpy as np

    from nico_selfmodel.files.csv_rows import number_of_word

    words = text.split(",")
    if len(words) != count:
        raise ValueError(f"{option} must be {expected}, got {text}")
    return np.array([number_of_word(word, option) for word in words])
