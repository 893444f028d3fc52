"""`nico-selfmodel simulate`: data of a simulated body."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import typer

from nico_selfmodel.cli import inputs, options, printer
from nico_selfmodel.cli import option_groups as groups

_LOOKS, _HANDS, _REFLECTIONS = 60, 80, 20
"""Poses of a whole body about the room, of each hand, and before each mirror, unless told."""


def motion_capture(
    out: options.Out,
    chain: groups.NicoOrChain,
    imperfections: options.Imperfections = "thesis",
    seed: options.RobotSeed = 0,
    session: options.Session = 0,
    circle_points: Annotated[
        int, typer.Option("--circle-points", min=0, help="Poses on each circle; 0 for none.")
    ] = 26,
    arc_share: Annotated[
        float,
        typer.Option("--arc-share", min=0.01, max=1.0, help="Share of the visible arcs swept."),
    ] = 1.0,
    random_poses: options.RandomPoses = 100,
    joint_noise_deg: options.JointNoise = None,
    backlash_deg: Annotated[
        float | None,
        typer.Option(
            "--backlash",
            min=0.0,
            max=90.0,
            metavar="DEG",
            help="Half width of the backlash that changes of direction cross.",
        ),
    ] = None,
    marker_mm: Annotated[
        float | None, typer.Option("--marker-mm", min=0.0, help="Marker noise, instead.")
    ] = None,
    force: options.Force = False,
) -> None:
    """Record a simulated arm under motion capture.

    Each joint is swept alone, then random poses are visited.
    """
    from nico_selfmodel.dataset.folder import save_dataset
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.planning.sweep_protocol import SweepProtocol
    from nico_selfmodel.sessions.simulated_session import simulated_session
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    refuse_existing(out, force=force)
    name = inputs.name_after(out)
    if circle_points == 0 and random_poses == 0:
        raise ValueError("nothing to record: give --circle-points or --random")
    chosen = imperfections_named(imperfections).with_noise(
        play_deg=joint_noise_deg, backlash_deg=backlash_deg, marker_mm=marker_mm
    )
    description = inputs.chosen_arm(chain)
    protocol = SweepProtocol.for_arm(description).on_share_of_arcs(arc_share)
    repeats = 1 if circle_points <= 3 else protocol.home_repeats
    protocol = replace(
        protocol,
        random_poses=random_poses,
        circle_points=max(circle_points, 1),
        home_repeats=repeats,
    )
    with printer.progress_bar() as progress:
        data = simulated_session(
            description,
            chosen,
            protocol,
            name,
            seed=seed,
            session=session,
            sweeps=circle_points > 0,
            progress=lambda done, total: progress("moving", done, total),
        )
    save_dataset(data, out, force=force)
    printer.dataset(data, out)


@dataclass(frozen=True)
class Looks(groups.OptionGroup):
    """What a whole body looks at."""

    looks: Annotated[
        int | None,
        typer.Option("--looks", min=0, help="Poses in which the head looks about the room; 60."),
    ] = None
    hands: Annotated[
        int | None, typer.Option("--hands", min=0, help="Poses of each hand before cameras; 80.")
    ] = None
    mirror: Annotated[
        list[str] | None,
        typer.Option(
            "--mirror",
            metavar="ID=MM,DEG,DEG",
            help="Record hands in a mirror: distance from the left camera of a head that looks "
            "straight ahead, turned to the right and upwards. Repeat for more; ID alone stands "
            "300 mm away, leaning back by 20 deg.",
        ),
    ] = None
    reflections: Annotated[
        int | None, typer.Option("--reflections", min=1, help="Poses before each mirror; 20.")
    ] = None

    def directly(self) -> tuple[int, int]:
        """Return poses about the room and of each hand: where a mirror is named, those asked."""
        return tuple(
            (0 if self.mirror else most) if asked is None else asked
            for asked, most in ((self.looks, _LOOKS), (self.hands, _HANDS))
        )  # pyright: ignore[reportReturnType]


def whole_body(
    out: options.Out,
    looked: Looks,
    imperfections: options.Imperfections = "thesis",
    seed: options.RobotSeed = 0,
    session: options.Session = 0,
    joint_noise_deg: options.JointNoise = None,
    force: options.Force = False,
) -> None:
    """Record a whole Nico that looks at a room and its hands.

    It is a recording of a body. With --mirror it looks at its hands in mirrors, and does the rest
    only where it is asked for. Places of markers in the images are projected, not found in
    pictures, and nothing hides them.
    """
    from nico_selfmodel.dataset.body.body_folder import save_body_dataset
    from nico_selfmodel.dataset.body.joining import joined
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.sessions.mirrors.nico_before_mirrors import mirrors_of_words
    from nico_selfmodel.sessions.mirrors.whole_nico_before_mirrors import session_before_mirrors
    from nico_selfmodel.sessions.whole_body import whole_body_session
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named

    refuse_existing(out, force=force)
    name, mirrors = inputs.name_after(out), mirrors_of_words(looked.mirror or ())
    if looked.reflections is not None and not mirrors:
        raise ValueError("--reflections are seen in a mirror: give --mirror")
    looks, hands = looked.directly()
    robot = (imperfections_named(imperfections).with_noise(play_deg=joint_noise_deg), seed, session)
    found = []
    with printer.progress_bar() as progress:
        about = {"name": name, "progress": partial(progress, "moving")}
        if looks + hands or not mirrors:
            found.append(whole_body_session(*robot, looks=looks, hands=hands, **about))
        if mirrors:
            poses = looked.reflections or _REFLECTIONS
            found.append(session_before_mirrors(*robot, mirrors, poses=poses, **about).data)
    data = joined(found[0], found[1], name) if len(found) == 2 else found[0]
    save_body_dataset(data, out, force=force)
    printer.body_dataset(data, out)
