"""`nico-selfmodel watch`: a simulated Nico live, prediction against observation."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from numpy.typing import NDArray


def watch(
    result: Annotated[Path, typer.Argument(help="Result folder of `learn`, with arm and eyes.")],
    world: Annotated[str, typer.Option("--world", help="thesis or clean.")] = "thesis",
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Which individual; the one that learned by default."),
    ] = None,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.1, help="End after so long.")
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option("--html", help="Visit random poses, write the recording as one page, end."),
    ] = None,
    mirror: Annotated[
        str | None,
        typer.Option(
            "--mirror",
            metavar="ID[=MM,DEG,DEG]",
            help="Put a mirror that the self-model knows before the eyes, placed as for `record`.",
        ),
    ] = None,
    poses: Annotated[int, typer.Option("--poses", min=1, help="Poses of the recording.")] = 12,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing page.")] = False,
) -> None:
    """Move a simulated Nico by sliders; see what it sees, and where it expects its hand."""
    from nico_selfmodel.files import refuse_existing, write_whole
    from nico_selfmodel.model import SelfModel
    from nico_selfmodel.systems import imperfections_named

    chosen = imperfections_named(world)
    if html is not None:
        refuse_existing(html, force=force)
    model = SelfModel.load(result)
    from nico_selfmodel.experiments.mirror_recording import mirror_of_words
    from nico_selfmodel.experiments.watching import Watching

    individual = int(model.provenance.get("seed") or 0) if seed is None else seed
    put = None
    if mirror is not None:
        name, place = mirror_of_words(mirror)
        put = (name, place if "=" in mirror else None)
    with Watching(model, chosen, individual, mirror=put, recording=html is not None) as watching:
        if html is not None:
            with console.progress_bar() as stage:
                watching.visit_random_poses(
                    poses, lambda done, total: stage("moving and looking", done, total)
                )
            write_whole(html, watching.view.html())
            console.out.print(f"{html}", markup=False)
            return
        url = watching.view.meshcat.web_url()
        console.out.print(f"open {url} (its stop button or Ctrl-C ends)", markup=False)
        watching.run(_tell, seconds or float("inf"))


def _tell(errors: "NDArray") -> None:
    """Say on one line, written over and over, how far prediction and observation are apart."""
    eyes = ("L", "R", "in the mirror L", "R")[: len(errors)]
    words = [
        f"{eye} {'not seen' if e != e else f'{e:.1f} px'}"
        for eye, e in zip(eyes, errors, strict=True)
    ]
    console.out.print("  " + "   ".join(words) + "      ", end="\r", markup=False)
