"""Stage 1b of the mirror test: what moves when I do, told by where it is.

A live picture of the robot, and another robot that imitates it at once, move when it does: timing
takes both for itself (stage 1).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.estimation.contingency.image_witness import (
    ANOTHER,
    CANNOT_TELL,
    MIRROR,
    PICTURE,
    ImageVerdict,
    tell_image,
)
from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.mirrors.hand_images import watch_images
from nico_selfmodel.sessions.mirrors.nico_before_mirrors import DEFAULT_MIRROR, NicoBeforeMirrors
from nico_selfmodel.sessions.motion_session import facing
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.systems.looking import LOOKING_DEG
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_station import NicoStation

TRUE_MIRROR, SCREEN, TWIN = "mirror", "live picture of itself", "twin that imitates at once"
ALLOWED = {TRUE_MIRROR: (MIRROR,), SCREEN: (PICTURE,), TWIN: (ANOTHER, CANNOT_TELL)}
"""What a robot may say of each."""
ENOUGH = 5
"""Of each that a verdict takes."""
_IMAGES = 12
"""Of its hand at which a robot ends."""
_WIDTH, _HEIGHT = 0.6, 0.45
"""Of mirror and screen [m]."""
_CHOICES = 2000
_FAMILIAR = 120
_DAY = 9


@dataclass(frozen=True)
class ImageTrial:
    """One image, and what was thought of it."""

    shown: str
    """What it was, which the robot was not told."""
    found: ImageVerdict
    """What the robot says."""

    @property
    def right(self) -> bool:
        """Whether it may say so."""
        return self.found.verdict in ALLOWED[self.shown]


@dataclass(frozen=True, eq=False)
class ImageStage:
    """All trials of the stage."""

    trials: tuple[ImageTrial, ...]
    """In the order in which they were made."""


def run_images(robots: Sequence[Acquainted], progress: Stage | None = None) -> ImageStage:
    """Let robots say what an image of them is.

    Args:
        robots: Who have learned arm and cameras.
    """
    done: list[ImageTrial] = []
    for i, robot in enumerate(robots):
        stage = of_robot(progress, i, len(robots))
        for k, shown in enumerate(ALLOWED):
            done.append(ImageTrial(shown, _told(robot, shown)))
            stage("telling images of itself", k + 1, len(ALLOWED))
    return ImageStage(tuple(done))


def _told(robot: Acquainted, shown: str) -> ImageVerdict:
    """Return what one robot says of one image."""
    nico = rendered(robot, ImageQuality())
    before = NicoBeforeMirrors(
        nico,
        {shown: DEFAULT_MIRROR},
        plate=MirrorPlate(width=_WIDTH, height=_HEIGHT, live=shown == SCREEN),
        familiar=robot.readings,
        choices=_CHOICES,
    )
    rng = np.random.default_rng((robot.seed, 48, len(shown)))
    view = before.views[shown]
    with NicoStation(
        robot.world, robot.seed, _DAY, arm=nico.arm, quality=nico.quality, mirror=before.plate,
        other=True,
    ) as station:  # fmt: skip
        poses = commands_of_angles(station.joints, nico.arm.lower, nico.arm.upper, view.q)
        commands = list(rng.permutation(poses))
        twin = facing(float(np.radians(LOOKING_DEG["neck_yaw"]))) if shown == TWIN else None
        X_BM = None if shown == TWIN else view.X_BM
        seen = watch_images(station, robot.model, commands, _IMAGES, X_BM=X_BM, X_WO=twin)
    return tell_image(seen, robot.model)


def images_document(stage: ImageStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(stage, shown) for shown in ALLOWED]
    failed = [
        f"{row['shown']}: {row['wrong']} of {row['trials']} are told wrongly"
        for row in rows
        if row["wrong"]
    ]
    fewest = min(row["trials"] for row in rows)
    said = f"{fewest} of each are told rightly"
    lacking = f"{said}, {ENOUGH} are needed" if fewest < ENOUGH else None
    return stage_document("1b", "what moves when I do", failed, lacking, said, images=rows)


def _row(stage: ImageStage, shown: str) -> dict[str, Any]:
    """Return what was said of one kind of image."""
    own = [one for one in stage.trials if one.shown == shown]
    words = [one.found.verdict for one in own]
    return {
        "shown": shown,
        "trials": len(own),
        "said": {word: words.count(word) for word in dict.fromkeys(words)},
        "wrong": sum(not one.right for one in own),
        "looks": [one.found.looks for one in own],
        "depth_mm": [one.found.depth_mm for one in own],
        "depth_sigma_mm": [one.found.depth_sigma_mm for one in own],
        "hand_mm": [one.found.hand_mm for one in own],
        "mirror_px": [one.found.mirror_px for one in own],
        "shared_log_odds": [one.found.shared for one in own],
    }


def images_table(stage: ImageStage) -> Table:
    """Return a row for each kind of image."""
    headings = (
        "shown", "trials", "said", "wrong", "off a plane [mm]", "noise of it [mm]",
        "own hand off one [mm]", "off the best mirror [px]", "errs as the own hand [log odds]",
    )  # fmt: skip
    rows = [
        [
            row["shown"],
            str(row["trials"]),
            ", ".join(f"{word} {count}" for word, count in row["said"].items()),
            str(row["wrong"]),
            _middle(row["depth_mm"]),
            _middle(row["depth_sigma_mm"]),
            _middle(row["hand_mm"]),
            _middle(row["mirror_px"]),
            _middle(row["shared_log_odds"]),
        ]
        for row in images_document(stage)["images"]
    ]
    return Table("Stage 1b: what moves when I do", headings, rows, "\n")


def _middle(values: Sequence[float]) -> str:
    """Return the median of what there is in words."""
    known = [value for value in values if np.isfinite(value)]
    return f"{np.median(known):.1f}" if known else "-"
