"""The part of `nico-selfmodel record` in which a whole body watches itself: `--head`, or a body."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from nico_selfmodel.cli import inputs, printer

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from nico_selfmodel.cli.record.hardware import Hardware
    from nico_selfmodel.cli.record.request import Request
    from nico_selfmodel.dataset.body.body_dataset import BodyDataset
    from nico_selfmodel.model.cameras.camera import Camera
    from nico_selfmodel.model.tree.body_model import BodyModel
    from nico_selfmodel.sessions.whole_recording import WholeRecording
    from nico_selfmodel.systems.simulated.imperfections import Imperfections

_LOOKS = 3
"""Poses of each hand for one look about the room."""


@dataclass(frozen=True)
class WholeRequest:
    """A whole body that is to be recorded."""

    request: "Request"
    """What else was asked for."""
    whole: "WholeRecording"
    """What moves, and what hangs about it."""
    lenses: "Mapping[str, Camera]"
    """Each camera's, by name."""
    learned: "BodyModel | None" = None
    """What was learned of its head, where that is known."""

    @classmethod
    def of(
        cls, request: "Request", *, head: bool, arms: str | None, room: Path | None, real: bool
    ) -> "WholeRequest | None":
        """Return what options ask for; None where they are about one arm.

        Raises:
            ValueError: If options do not fit.
            SelfModelError: If a file is not valid.
        """
        from nico_selfmodel.model.tree.body_model import is_body

        known = request.cameras is not None and is_body(request.cameras)
        if not known and not head:
            if arms is not None or room is not None:
                raise ValueError("--arms and --room need --head, which turns to hands and cards")
            return None
        if request.images or request.sensor != "stereo-fiducial":
            raise ValueError(
                "a whole body is recorded by markers on its hands: leave out --images and --sensor"
            )
        if request.asked_circle is not None:
            raise ValueError("--circle is for one arm: a whole body is sent to --random poses")
        if request.poses is None and not request.random:
            raise ValueError("nothing to record: give --random N of 1 or more, or --poses FILE")
        if real and room is None:
            raise ValueError(
                "--room is missing: a YAML file (nico-cards/1) of where the cards hang about the "
                "robot, as examples/nico_room.yaml"
            )
        moving, lenses, learned = _known_parts(request, arms, known=known)
        return cls(request, _whole(moving, room), lenses, learned)

    @property
    def counts(self) -> tuple[int, int]:
        """Looks about the room, and poses of each hand."""
        random = self.request.random
        return (max(1, random // _LOOKS), random) if self.whole.arms else (random, 0)

    @property
    def poses(self) -> "NDArray | None":
        """The poses that were given instead. Shape (N, k)."""
        return inputs.poses_of(self.request.poses, self.whole.body.joints)

    def save(self, data: "BodyDataset") -> None:
        """Write the recording and tell of it."""
        from nico_selfmodel.dataset.body.body_folder import save_body_dataset

        save_body_dataset(data, self.request.out)
        printer.body_dataset(data, self.request.out)


def _known_parts(
    request: "Request", arms: str | None, *, known: bool
) -> "tuple[tuple[str, ...], Mapping[str, Camera], BodyModel | None]":
    """Return the arms that move, the cameras' lenses by name, and what was learned of the head."""
    from nico_selfmodel.model.tree.body_model import load_body
    from nico_selfmodel.systems.looking import arms_among
    from nico_selfmodel.systems.nico_cameras import MOUNTS

    if known:
        assert request.cameras is not None
        if arms is not None:
            raise ValueError("--arms: the body of --cameras says which joints move; leave it out")
        body = load_body(request.cameras)
        return arms_among(body.tree.joints), dict(body.tree.lenses), body
    chosen = inputs.arms_named(arms)
    rig = inputs.cameras_of(request.cameras)
    if rig is None:
        raise ValueError(
            "--head needs --cameras, whose lenses tell where markers are: what `calibrate stereo` "
            "or `learn --head` left"
        )
    return chosen, dict(zip(MOUNTS, rig.cameras, strict=True)), None


def _whole(arms: tuple[str, ...], room: Path | None) -> "WholeRecording":
    from nico_selfmodel.sessions.whole_recording import WholeRecording
    from nico_selfmodel.systems.stations.nico_detectors import FIDUCIALS
    from nico_selfmodel.vision.markers.tag_card_file import load_cards

    if room is None:
        return WholeRecording(arms)
    return WholeRecording(arms, load_cards(room, FIDUCIALS.values()))


def record_body(asked: WholeRequest, world: "Imperfections") -> None:
    """Let a whole simulated Nico look about a room and at its hands.

    Raises:
        SelfModelError: If nothing was seen, or a file cannot be written.
    """
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.sessions.rendered_body import RenderedBody

    request = asked.request
    refuse_existing(request.out, force=False)
    if request.mirrors:
        asked.save(_before_mirrors(asked, world))
        return
    with printer.progress_bar() as progress:
        data = RenderedBody(world, request.seed, asked.whole).record(
            inputs.name_after(request.out),
            request.session,
            *asked.counts,
            lenses=asked.lenses,
            learned=asked.learned,
            poses=asked.poses,
            progress=lambda done, total: progress("moving and looking", done, total),
        )
    asked.save(data)


def _before_mirrors(asked: WholeRequest, world: "Imperfections") -> "BodyDataset":
    """Let it look at its hands in mirrors."""
    from nico_selfmodel.sessions.mirrors.body_recorded_before_mirrors import (
        body_recorded_before_mirrors,
    )
    from nico_selfmodel.sessions.mirrors.nico_before_mirrors import mirrors_of_words

    request = asked.request
    with printer.progress_bar() as progress:
        return body_recorded_before_mirrors(
            world,
            request.seed,
            request.session,
            asked.whole,
            mirrors_of_words(request.mirrors or ()),
            request.random,
            inputs.name_after(request.out),
            lenses=asked.lenses,
            progress=lambda done, total: progress("looking into mirrors", done, total),
        )


def record_real_body(asked: WholeRequest, hardware: "Hardware") -> None:
    """Move the real head and arms and record what is seen; an interrupted recording goes on.

    Samples are kept beside the folder that is made, until that is there.

    Raises:
        ValueError: If an option is missing or does not fit.
        SelfModelError: If the robot fails, or a file is not valid.
    """
    import shutil
    from dataclasses import replace

    import numpy as np

    from nico_selfmodel.cli.record.hardware import configuration, run_hardware
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.model.cameras.stereo_rig import StereoRig
    from nico_selfmodel.sessions.hardware_recording import RealBodyRecording

    request = asked.request
    refuse_existing(request.out, force=False)
    hardware.refuse_arm("a whole body is Nico's")
    config = configuration(hardware)
    rng = np.random.default_rng((request.seed, request.session, 2))
    planned = RealBodyRecording.planned(
        asked.whole, config.joint_infos, *asked.counts, rng, asked.poses, asked.learned
    )
    samples = request.out.with_name(f"{request.out.name}.samples")
    rig = StereoRig(*asked.lenses.values())
    data = run_hardware(planned, config, replace(request, out=samples), hardware, rig)
    named = replace(data, name=inputs.name_after(request.out))
    asked.save(asked.whole.dataset(named, asked.lenses))
    shutil.rmtree(samples)
