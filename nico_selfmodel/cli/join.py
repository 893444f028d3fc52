"""`nico-selfmodel join`: recordings of one body as one."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer


def join(
    datasets: Annotated[list[Path], typer.Argument(help="Folders of recordings of one body.")],
    out: options.Out,
    force: options.Force = False,
) -> None:
    """Write recordings of one body as one, with all sensors.

    What has one name in several is one marker, sensor or mirror, and must be the same in all;
    joints too. Samples are numbered anew.
    """
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset, save_body_dataset
    from nico_selfmodel.dataset.body.joining import all_joined
    from nico_selfmodel.files.whole import refuse_existing

    refuse_existing(out, force=force, inputs=datasets)
    recordings = [load_body_dataset(folder) for folder in datasets]
    data = all_joined(recordings, out.name)
    save_body_dataset(data, out, force=force)
    printer.body_dataset(data, out)
