"""`nico-selfmodel choose-poses`: which poses to record next."""

import shlex
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer


def choose_poses(
    model: options.Model,
    dataset: options.Dataset,
    out: options.OutFile,
    count: options.Count = 20,
    criterion: Annotated[
        str,
        typer.Option("--criterion", help="I: predict the hand well; D: know all parameters."),
    ] = "I",
    marker: options.Marker = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the pool of poses.")] = 0,
    force: options.Force = False,
    as_json: options.AsJson = False,
) -> None:
    """Choose the poses that would tell a learned arm most beyond the data it was learned from.

    They lie between the readings that were recorded, and in view of learned cameras. See that
    nothing is in the way before moving there.
    """
    import numpy as np

    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.model.readings import readings_table
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.planning.next_poses import choose_next_poses

    refuse_existing(out, force=force)
    learned = load_model(model)
    chosen = choose_next_poses(
        learned,
        load_dataset(dataset),
        count,
        np.random.default_rng(seed),
        criterion=criterion,
        marker=marker,
    )
    write_whole(out, readings_table(chosen.readings, learned.joints))
    before, after = 1e3 * chosen.sigma_before, 1e3 * chosen.sigma_after
    if as_json:
        sigmas = {"sigma_before_mm": before, "sigma_after_mm": after}
        printer.as_json({"poses": chosen.readings.tolist(), **sigmas})
        return
    recording = shlex.join(map(str, ["--poses", out, "--out", inputs.beside(out, "recorded")]))
    printer.line(
        f"{count} poses: {out}\n"
        f"reducible error of the predicted hand, rms: now {before:.3g} mm, with these poses "
        f"{after:.3g} mm\n"
        f"next  nico-selfmodel record {recording}"
    )
