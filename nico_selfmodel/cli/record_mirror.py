"""The part of `nico-selfmodel record` that puts mirrors before the simulated robot."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console
from nico_selfmodel.cli.given_names import name_after

if TYPE_CHECKING:
    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.systems import Imperfections

Mirrors = Annotated[
    list[str] | None,
    typer.Option(
        "--mirror",
        metavar="ID[=MM,DEG,DEG]",
        help="Record the hand in a mirror too: its distance from the left eye, and how far it is "
        "turned to the image's right and upwards; 300,0,-20 if left out. Repeat for more mirrors.",
    ),
]
POSES = 20
"""Poses in each mirror, and without one, unless told otherwise."""


def record_before_mirrors(
    out: Path,
    sensor: str,
    world: "Imperfections",
    seed: int,
    session: int,
    mirrors: list[str],
    poses: int,
    eyes: Path | None,
    images: bool,
) -> "Dataset":
    """Record the hand directly, then in every mirror.

    Args:
        out: Folder to make; a recording in it is resumed.
        sensor: `stereo-fiducial` or `stereo-color`.
        world: What is wrong with the body.
        seed: Which individual.
        session: Which day.
        mirrors: As on the command line.
        poses: In each mirror, and without one.
        eyes: A self-model with calibrated eyes; with an arm too for red tape, whose reflection only
            a body that knows where its hand is can tell from it.
        images: Keep the pictures.

    Returns:
        The data set.

    Raises:
        ValueError: If two mirrors have one name, or tape is to be told without a self-model.
    """
    from nico_selfmodel.experiments.eyes_lesson import MARKERS, RenderedNico
    from nico_selfmodel.experiments.mirror_recording import NicoBeforeMirrors, mirror_of_words
    from nico_selfmodel.model import SelfModel

    places = [mirror_of_words(words) for words in mirrors]
    if len(dict(places)) < len(places):
        raise ValueError("two mirrors have one name: give each --mirror its own")
    model = None if eyes is None else SelfModel.load(eyes)
    knows = model if model is not None and model.has_arm else None
    if sensor == "stereo-color" and (knows is None or MARKERS[sensor] not in knows.markers):
        raise ValueError(
            "red tape and its reflection look alike: give --eyes a self-model with an arm that was "
            "learned by --sensor stereo-color, or take --sensor stereo-fiducial"
        )
    nico = RenderedNico(world, seed, (MARKERS[sensor],))
    rig = None if model is None else model.rig
    body = NicoBeforeMirrors(nico, dict(places), knows=knows, rig=rig)
    with console.progress_bar() as stage:
        return body.record(
            name_after(out),
            session,
            poses,
            poses,
            folder=out,
            keep_images=images,
            progress=lambda done, total: stage("looking into mirrors", done, total),
        )
