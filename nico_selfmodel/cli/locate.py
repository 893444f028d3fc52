"""`nico-selfmodel locate`: where a thing is that is seen only in a mirror."""

import warnings
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer


def locate(
    model: options.Model,
    mirror: Annotated[str, typer.Option("--mirror", help="Name of the mirror.")],
    pixels: Annotated[
        list[str],
        typer.Option(
            "--pixels",
            metavar="U,V,U,V",
            help="Where the left and the right camera see the reflection. Repeat for more things.",
        ),
    ],
    pixel_sigma: options.PixelSigma = None,
    as_json: options.AsJson = False,
) -> None:
    """Say where things are that are seen in a mirror: x, y, z [m].

    With a sigma [mm]. The noise of a pixel is the model's, where none is given.
    """
    from nico_selfmodel.errors import ModelError
    from nico_selfmodel.model.cameras.mirror_location import locate_in_mirror
    from nico_selfmodel.model.self_model_file import load_model

    with warnings.catch_warnings(record=True) as said:
        body = load_model(model)
    rig, failure = body.mirror_rig(mirror), body.mirror_failure(mirror)
    if failure is not None:  # which says more than that the result failed
        raise ModelError(
            f"mirror {mirror!r} failed its calibration ({failure}): what is seen in it is not "
            "where it seems; cure that and run `nico-selfmodel calibrate mirror` again"
        )
    for one in said:
        warnings.warn(one.message, one.category, stacklevel=1)
    sigma = pixel_sigma if pixel_sigma is not None else body.pixel_sigma or 1.0
    found = locate_in_mirror(rig, [_pixels(word) for word in pixels], sigma)
    rows = [place.as_document() for place in found]
    if as_json:
        printer.as_json({"mirror": mirror, "pixel_sigma_px": sigma, "places": rows})
        return
    headings = ("x m", "y m", "z m", "sigma mm", "along the view", "across", "off by px")
    cells = [[f"{row[key]:.{digits}f}" for key, digits in _SHOWN] for row in rows]
    printer.table(f"seen in mirror {mirror}", headings, cells)


_SHOWN = (
    ("x_m", 4),
    ("y_m", 4),
    ("z_m", 4),
    ("sigma_mm", 1),
    ("sigma_along_mm", 1),
    ("sigma_across_mm", 1),
    ("miss_px", 2),
)


def _pixels(word: str) -> list[float]:
    """Read four numbers.

    Raises:
        ValueError: If there are others.
    """
    from nico_selfmodel.files.csv_rows import number_of_word

    cells = word.split(",")
    values = [number_of_word(cell, f"--pixels {word}") for cell in cells]
    if len(values) != 4:
        raise ValueError(
            f"--pixels {word}: got {len(values)} numbers, expected left u, v and right u, v"
        )
    return values
