"""The command tree, and what an error looks like."""

import os
import sys
import warnings

import typer

from nico_selfmodel.cli import (
    calibrate,
    evaluate,
    experiment,
    export_urdf,
    import_data,
    learn,
    predict,
    simulate,
    view,
)
from nico_selfmodel.errors import SelfModelError

app = typer.Typer(
    name="nico-selfmodel",
    help="A robot learns its own body by watching it move.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.command("learn")(learn.learn)
app.command("evaluate")(evaluate.evaluate)
app.command("predict")(predict.predict)
app.command("export-urdf")(export_urdf.export_urdf)
app.command("view")(view.view)
app.add_typer(simulate.app, name="simulate")
app.add_typer(import_data.app, name="import")
app.add_typer(calibrate.app, name="calibrate")
app.add_typer(experiment.app, name="experiment")


@app.callback()
def _describe() -> None:
    """A robot learns its own body by watching it move."""


def main() -> None:
    """Run the command line; an error is one clear line and exit code 2."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    warnings.showwarning = _show_warning
    try:
        app()
    except (SelfModelError, ValueError, OSError) as error:
        sys.stdout.flush()
        print(f"nico-selfmodel: {_one_line(error)}", file=sys.stderr)
        raise SystemExit(2) from None
    except KeyboardInterrupt:
        print("nico-selfmodel: stopped", file=sys.stderr)
        raise SystemExit(130) from None


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"nico-selfmodel: warning: {' '.join(str(message).split())}", file=sys.stderr)
