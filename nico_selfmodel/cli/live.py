"""`nico-selfmodel live`: a simulated Nico live, prediction against observation."""

from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer

if TYPE_CHECKING:
    from numpy.typing import NDArray


def live(
    model: options.Model,
    imperfections: options.Imperfections = "thesis",
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="Which robot instance; by default the one learned."),
    ] = None,
    seconds: options.Seconds = None,
    out: options.OutPage = None,
    mirror: Annotated[
        str | None,
        typer.Option(
            "--mirror",
            metavar=options.MIRROR,
            help="Put a mirror that the self-model knows before the robot, placed as for `record`.",
        ),
    ] = None,
    count: options.Count = 12,
    force: options.Force = False,
) -> None:
    """Move a simulated Nico by sliders; see what it sees, and where it expects its hand.

    With --out it goes through random poses instead, onto a page.
    """
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    chosen = imperfections_named(imperfections)
    if is_body(model):
        raise ValueError(
            f"{model} is a whole body, and `live` moves one arm before a head that stands still: "
            "give the folder that `learn` without --head leaves; `view` shows a whole body, "
            "`record --cameras` moves it"
        )
    if out is not None:
        refuse_existing(out, force=force)
    known = load_model(model)
    from nico_selfmodel.sessions.nico_before_mirrors import mirror_of_words
    from nico_selfmodel.sessions.watching import Watching

    instance = int(known.provenance.get("seed") or 0) if seed is None else seed
    put = None
    if mirror is not None:
        name, place = mirror_of_words(mirror)
        put = (name, place if "=" in mirror else None)
    with Watching(known, chosen, instance, mirror=put, recording=out is not None) as watching:
        if out is not None:
            with printer.progress_bar() as progress:
                watching.visit_random_poses(
                    count, lambda done, total: progress("moving and looking", done, total)
                )
            write_whole(out, watching.view.html())
            printer.line(f"{out}")
            return
        from nico_selfmodel.viz.live.live_page import LivePage

        with LivePage(watching.view.meshcat) as page:
            watching.go_into_view()
            printer.line(f"open {page.url} (its stop button or Ctrl-C ends)")
            watching.run(_tell, seconds or float("inf"))


def _tell(errors: "NDArray") -> None:
    """Say on one line, written over and over, how far prediction and observation are apart."""
    cameras = ("L", "R", "in the mirror L", "R")[: len(errors)]
    words = [
        f"{camera} {'not seen' if e != e else f'{e:.1f} px'}"
        for camera, e in zip(cameras, errors, strict=True)
    ]
    printer.line("  " + "   ".join(words) + "      ", end="\r")
