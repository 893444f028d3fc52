"""`nico-selfmodel pick-color`: teach a colour by pointing at it."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer


def pick_color(
    image: Annotated[Path, typer.Argument(help="A photograph that shows the colour.")],
    out: options.OutFile,
    at: Annotated[
        list[str] | None,
        typer.Option(
            "--at", metavar="U,V", help="A pixel of the colour; again for more. No window opens."
        ),
    ] = None,
    radius: Annotated[
        float, typer.Option("--radius", min=0.0, help="Pixels around each that count too.")
    ] = 3.0,
    mask: Annotated[
        Path | None, typer.Option("--mask", help="PNG to make, white where the colour is seen.")
    ] = None,
    force: options.Force = False,
) -> None:
    """Learn thresholds of a colour from pixels of a photograph.

    You click on them in a window, or name them with --at. The thresholds are a YAML.
    """
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.vision.color.color_blob import color_mask, find_color_blob
    from nico_selfmodel.vision.color.color_model import ColorModel
    from nico_selfmodel.vision.images.image_file import looking_at, read_image, write_image
    from nico_selfmodel.vision.images.not_seen import NotSeen

    for path in filter(None, (out, mask)):
        refuse_existing(path, force=force, inputs=[image])
    photograph = read_image(image)
    if at:
        points = [_pixel(text) for text in at]
        model = ColorModel.from_clicks([photograph], [points], radius)
    else:
        from nico_selfmodel.viz.live.color_picker import pick_color as open_window

        model = open_window(photograph, image.name, radius)
    with looking_at(image):
        seen = color_mask(photograph, model)
        blob = find_color_blob(photograph, model, mask=seen)
    if mask is not None:
        write_image(mask, seen.astype("uint8") * 255)
    model.save(out)
    if isinstance(blob, NotSeen):
        words = f"but no patch of it is seen for certain in {image}: {blob.reason}"
    else:
        words = f"seen in {image} at {blob.center[0]:.1f},{blob.center[1]:.1f}"
    printer.line(f"{out}: {model.dominant}, hue {model.hue_deg:g} deg; {words}")


def _pixel(text: str) -> tuple[float, float]:
    try:
        u, v = (float(number) for number in text.split(","))
    except ValueError:
        raise ValueError(f"--at takes a pixel as u,v, such as 320,240; got {text!r}") from None
    return u, v
