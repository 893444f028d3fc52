"""`nico-selfmodel choose-poses`: which poses to record next."""

from pathlib import Path
from typing import Annotated

import typer

from nico_selfmodel.cli import console


def choose_poses(
    model: Annotated[Path, typer.Argument(help="self_model.yaml, or a result folder.")],
    dataset: Annotated[Path, typer.Argument(help="What it was learned from.")],
    out: Annotated[Path, typer.Option("--out", help="CSV to write: readings to go to.")],
    count: Annotated[int, typer.Option("--count", min=1, help="How many poses.")] = 20,
    criterion: Annotated[
        str,
        typer.Option("--criterion", help="I: predict the hand well; D: know all parameters."),
    ] = "I",
    marker: Annotated[str | None, typer.Option("--marker", help="Which tracked point.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the pool of poses.")] = 0,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Choose the poses that would tell a learned arm most beyond what it knows.

    They lie between the readings that were recorded, and in view of learned eyes. Check before
    moving there that nothing is in the way.
    """
    import numpy as np

    from nico_selfmodel.dataset import Dataset
    from nico_selfmodel.estimation.next_poses import choose_next_poses
    from nico_selfmodel.files import refuse_existing, write_whole
    from nico_selfmodel.model import SelfModel
    from nico_selfmodel.model.readings import readings_table

    refuse_existing(out, force=force)
    learned = SelfModel.load(model)
    chosen = choose_next_poses(
        learned,
        Dataset.load(dataset),
        count,
        np.random.default_rng(seed),
        criterion=criterion,
        marker=marker,
    )
    write_whole(out, readings_table(chosen.readings, learned.joints))
    sigmas = {
        "sigma_before_mm": 1e3 * chosen.sigma_before,
        "sigma_after_mm": 1e3 * chosen.sigma_after,
    }
    if as_json:
        console.print_json({"poses": chosen.readings.tolist(), **sigmas})
        return
    console.out.print(
        f"{count} poses: {out}\n"
        f"rms error of the predicted hand, for what data can cure: now "
        f"{sigmas['sigma_before_mm']:.3g} mm, with these poses {sigmas['sigma_after_mm']:.3g} mm\n"
        f"next  nico-selfmodel record NAME --poses {out}",
        markup=False,
    )
