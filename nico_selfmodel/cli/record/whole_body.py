"""The part of `nico-selfmodel record` that a whole body watches itself in: `--cameras` a body."""

from typing import TYPE_CHECKING

from nico_selfmodel.cli import inputs, printer

if TYPE_CHECKING:
    from nico_selfmodel.cli.record.request import Request
    from nico_selfmodel.systems.simulated.imperfections import Imperfections

_LOOKS = 3
"""Poses of each hand for one look about the room."""


def record_body(request: "Request", world: "Imperfections") -> None:
    """Let a whole simulated Nico look about a room and at its hands, with lenses that it learned.

    Raises:
        ValueError: If the body has joints that the robot does not command.
        SelfModelError: If a file is not valid.
    """
    from nico_selfmodel.dataset.body.body_folder import save_body_dataset
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.model.cameras.stereo_rig import StereoRig
    from nico_selfmodel.model.tree.body_model import load_body
    from nico_selfmodel.sessions.rendered_body import RenderedBody
    from nico_selfmodel.sessions.whole_scenario import with_lenses
    from nico_selfmodel.systems.looking import arms_among

    assert request.cameras is not None
    refuse_existing(request.out, force=False)
    if request.mirrors or request.images or request.sensor != "stereo-fiducial":
        raise ValueError(
            "a whole body is recorded by markers on its hands: leave out --mirror, --images and "
            "--sensor"
        )
    if request.poses is None and not request.random:
        raise ValueError("nothing to record: give --random N of 1 or more, or --poses FILE")
    body = load_body(request.cameras)
    arms = arms_among(body.tree.joints)
    robot = RenderedBody(world, request.seed, arms)
    lenses = dict(body.tree.lenses)
    hands = request.random if arms else 0
    with printer.progress_bar() as progress:
        data = robot.record(
            inputs.name_after(request.out),
            request.session,
            max(1, request.random // _LOOKS) if arms else request.random,
            hands,
            rig=StereoRig(*lenses.values()),
            poses=inputs.poses_of(request.poses, robot.body.joints),
            progress=lambda done, total: progress("moving and looking", done, total),
        )
    data = with_lenses(data, lenses)
    save_body_dataset(data, request.out)
    printer.body_dataset(data, request.out)
