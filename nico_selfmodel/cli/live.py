"""`nico-selfmodel live`: a simulated Nico live, prediction against observation."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.model.cameras.mirror import Mirror
    from nico_selfmodel.sessions.watching import Watching
    from nico_selfmodel.sessions.watching_body import WatchingBody
    from nico_selfmodel.systems.simulated.imperfections import Imperfections


def live(
    model: options.Model,
    imperfections: options.Imperfections = "thesis",
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed", min=0, help="Random seed: which simulated robot; the one learned by default."
        ),
    ] = None,
    seconds: options.Seconds = None,
    out: options.OutPage = None,
    mirror: Annotated[
        str | None,
        typer.Option(
            "--mirror",
            metavar=options.MIRROR,
            help="Put a mirror that the model knows before the robot, placed as it was recorded.",
        ),
    ] = None,
    count: options.Count = 12,
    force: options.Force = False,
) -> None:
    """Move a simulated Nico by sliders, live in Meshcat.

    It shows what the robot sees, and where it expects its hand. With --out it goes through random
    poses instead, onto a page. A whole body (body.yaml, of `learn --head`) looks about a room and
    at its hands.
    """
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    chosen = imperfections_named(imperfections)
    if out is not None:
        refuse_existing(out, force=force)
    with _awake(model, chosen, seed, mirror, out is not None) as watching:
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


def _placed(mirror: str | None) -> "tuple[str, Mirror | None] | None":
    """Return a mirror's name, and where it is put; None as place where nobody says it."""
    from nico_selfmodel.sessions.mirrors.nico_before_mirrors import mirror_of_words

    if mirror is None:
        return None
    name, place = mirror_of_words(mirror)
    return name, place if "=" in mirror else None


def _awake(
    model: Path, world: "Imperfections", seed: int | None, mirror: str | None, recording: bool
) -> "Watching | WatchingBody":
    """Wake up a whole Nico in its room, or one arm before a head that stands still."""
    from nico_selfmodel.model.self_model import SelfModel
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.model.tree.body_model import is_body, load_body

    known = load_body(model) if is_body(model) else load_model(model)
    instance = int(known.provenance.get("seed") or 0) if seed is None else seed
    placed = _placed(mirror)
    if isinstance(known, SelfModel):
        from nico_selfmodel.sessions.watching import Watching

        return Watching(known, world, instance, mirror=placed, recording=recording)
    from nico_selfmodel.sessions.watching_body import WatchingBody

    return WatchingBody(known, world, instance, mirror=placed, recording=recording)


def _tell(errors: "NDArray | Mapping[str, NDArray]") -> None:
    """Say on one line, written over and over, how far prediction and observation are apart."""
    if isinstance(errors, Mapping):
        names = tuple(f"{name} {side}" for name in errors for side in "LR")
        values = [value for both in errors.values() for value in both]
    else:
        names, values = ("L", "R", "in the mirror L", "R")[: len(errors)], list(errors)
    told = zip(names, values, strict=True)
    words = [f"{name} {'not seen' if e != e else f'{e:.1f} px'}" for name, e in told]
    printer.line("  " + "   ".join(words) + "      ", end="\r")
