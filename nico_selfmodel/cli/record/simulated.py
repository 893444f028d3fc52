"""The part of `nico-selfmodel record` that moves a simulated robot."""

import shlex
from dataclasses import replace
from typing import TYPE_CHECKING

from nico_selfmodel.cli import inputs, printer

if TYPE_CHECKING:
    from nico_selfmodel.cli.record.request import Request
    from nico_selfmodel.dataset.dataset import Dataset
    from nico_selfmodel.systems.simulated.imperfections import Imperfections


def record_hand(request: "Request", world: "Imperfections") -> "Dataset":
    """Record the hand: by motion capture, by the robot's cameras, or in mirrors too.

    Raises:
        ValueError: If an option does not fit.
        SelfModelError: If a file is not valid.
    """
    if request.mirrors:
        return _before_mirrors(request, world)
    by = _by_motion_capture if request.sensor == "motion-capture" else _by_cameras
    return by(request, world)


def record_boards(request: "Request", world: "Imperfections", count: int) -> None:
    """Record photographs of a chessboard by both cameras."""
    from nico_selfmodel.files.whole import folder_written_whole
    from nico_selfmodel.sessions.camera_scenario import RenderedNico

    out = request.out
    with folder_written_whole(out) as folder, printer.progress_bar() as progress:
        nico = RenderedNico(world, request.seed, ("fiducial",))
        nico.board_views(
            count,
            request.session,
            folder=folder,
            progress=lambda done, total: progress("looking at a chessboard", done, total),
        )
    cameras = inputs.beside(out, "cameras")
    printer.line(
        f"{count} pairs: {out}\n"
        f"next  nico-selfmodel calibrate stereo {shlex.quote(str(out))} --board 9x6 --square-mm 28 "
        f"--window 5 --out {shlex.quote(str(cameras))}"
    )


def _by_cameras(request: "Request", world: "Imperfections") -> "Dataset":
    from nico_selfmodel.sessions.camera_scenario import MARKERS, RenderedNico

    rig = inputs.cameras_of(request.cameras)
    nico = RenderedNico(world, request.seed, (MARKERS[request.sensor],))
    with printer.progress_bar() as progress:
        return nico.record(
            inputs.name_after(request.out),
            request.session,
            request.circle,
            request.random,
            rig=rig,
            folder=request.out,
            keep_images=request.images,
            poses=inputs.poses_of(request.poses, nico.arm.joints),
            progress=lambda done, total: progress("moving and looking", done, total),
        )


def _by_motion_capture(request: "Request", world: "Imperfections") -> "Dataset":
    from nico_selfmodel.planning.sweep_protocol import SweepProtocol
    from nico_selfmodel.plant import ArmDescription
    from nico_selfmodel.sessions.simulated_session import simulated_session

    arm = ArmDescription.named("nico")
    each = max(1, round(request.circle / len(arm.joints))) + 1
    protocol = SweepProtocol.for_arm(arm)
    protocol = replace(protocol, random_poses=request.random, circle_points=each)
    with printer.progress_bar() as progress:
        return simulated_session(
            arm,
            world,
            protocol,
            inputs.name_after(request.out),
            seed=request.seed,
            session=request.session,
            sweeps=request.circle > 0,
            folder=request.out,
            poses=inputs.poses_of(request.poses, arm.joints),
            progress=lambda done, total: progress("moving", done, total),
        )


def _before_mirrors(request: "Request", world: "Imperfections") -> "Dataset":
    """Record the hand directly, then in every mirror.

    Red tape needs a self-model with an arm: only a body that knows where its hand is can tell tape
    from its reflection.
    """
    from nico_selfmodel.model.self_model_file import load_model
    from nico_selfmodel.sessions.camera_scenario import MARKERS, RenderedNico
    from nico_selfmodel.sessions.mirrors.nico_before_mirrors import (
        NicoBeforeMirrors,
        mirrors_of_words,
        plate_of_words,
    )

    places, plate = mirrors_of_words(request.mirrors or ()), plate_of_words(request.glass)
    model = None if request.cameras is None else load_model(request.cameras)
    knows = model if model is not None and model.has_arm else None
    marker = MARKERS[request.sensor]
    if request.sensor == "stereo-color" and (knows is None or marker not in knows.markers):
        raise ValueError(
            "red tape and its reflection look alike: give --cameras a self-model with an arm that "
            "was learned by --sensor stereo-color, or take --sensor stereo-fiducial"
        )
    nico = RenderedNico(world, request.seed, (marker,))
    rig = None if model is None else model.rig
    body = NicoBeforeMirrors(nico, places, plate=plate, knows=knows, rig=rig)
    with printer.progress_bar() as progress:
        return body.record(
            inputs.name_after(request.out),
            request.session,
            request.random,
            request.random,
            folder=request.out,
            keep_images=request.images,
            progress=lambda done, total: progress("looking into mirrors", done, total),
        )
