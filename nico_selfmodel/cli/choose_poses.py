"""`nico-selfmodel choose-poses`: which poses to record next."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nico_selfmodel.cli import inputs, options, printer

if TYPE_CHECKING:
    from nico_selfmodel.planning.pose_selection import NextPoses


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
    """Choose new poses that would tell most about an arm or body.

    Beyond what it was learned from, that is. They lie between the readings that were recorded, and
    in view of learned cameras. See that nothing is in the way before moving there.
    """
    import numpy as np

    from nico_selfmodel.dataset.readings import readings_table
    from nico_selfmodel.files.whole import refuse_existing, write_whole
    from nico_selfmodel.model.tree.body_model import is_body

    refuse_existing(out, force=force, inputs=[model, dataset])
    choose = _of_a_body if is_body(model) else _of_an_arm
    rng = np.random.default_rng(seed)
    joints, chosen = choose(model, dataset, count, rng, criterion=criterion, marker=marker)
    _warn_of_another(model, dataset)
    write_whole(out, readings_table(chosen.readings, joints))
    pixels = chosen.unit == "px"
    unit, scale = ("px", 1.0) if pixels else ("mm", 1e3)
    before, after = scale * chosen.sigma_before, scale * chosen.sigma_after
    if as_json:
        sigmas = {f"sigma_before_{unit}": before, f"sigma_after_{unit}": after}
        printer.as_json({"poses": chosen.readings.tolist(), **sigmas})
        return
    printer.line(
        f"{count} poses: {out}\n"
        f"reducible error of the predicted marker{' in the images' if pixels else ''}, rms: now "
        f"{before:.3g} {unit}, with these poses {after:.3g} {unit}\n"
        f"next  {_next(joints, out, model if pixels else None)}"
    )


def _next(joints: tuple[str, ...], poses: Path, cameras: Path | None) -> str:
    """Return what is to be done next: the commands themselves move no robot but Nico."""
    from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS

    if not {*HEAD_JOINTS, *ARM_JOINTS["left"], *ARM_JOINTS["right"]}.issuperset(joints):
        return "move the robot there, record, and calibrate by that and what was recorded before"
    words = [] if cameras is None else ["--cameras", cameras]
    words += ["--poses", poses, "--out", inputs.beside(poses, "recorded")]
    return f"nico-selfmodel record {shlex.join(map(str, words))}"


def _warn_of_another(model: Path, dataset: Path) -> None:
    """Warn where the data contradict the model: what it would learn most from is then another."""
    import warnings

    from nico_selfmodel.cli.evaluate import held_against
    from nico_selfmodel.errors import SelfModelError

    try:
        verdict = held_against(model, dataset)[0]
    except SelfModelError:
        return  # nothing was measured that it could be held against
    if verdict.status == "FAIL":
        warnings.warn(f"the data contradict the model: {verdict.reasons[0]}", stacklevel=2)


def _of_an_arm(
    model: Path, dataset: Path, *how: Any, **wanted: Any
) -> "tuple[tuple[str, ...], NextPoses]":
    from nico_selfmodel.dataset.folder import load_dataset
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.planning.next_poses import choose_next_poses

    learned = load_model(model)
    return learned.joints, choose_next_poses(learned, load_dataset(dataset), *how, **wanted)


def _of_a_body(
    model: Path, dataset: Path, *how: Any, **wanted: Any
) -> "tuple[tuple[str, ...], NextPoses]":
    """Return which joints are moved, and where to: those that follow others go by themselves."""
    from nico_selfmodel.dataset.body.body_folder import load_body_dataset
    from nico_selfmodel.model.tree.body_model import load_body
    from nico_selfmodel.planning.next_body_poses import choose_next_body_poses

    learned, data = load_body(model), load_body_dataset(dataset)
    chosen = choose_next_body_poses(learned, data, *how, **wanted)
    read = [i for i, joint in enumerate(data.joints) if joint.is_read]
    names = tuple(data.joint_names[i] for i in read)
    return names, replace(chosen, readings=chosen.readings[:, read])
