"""Stage 1c of the mirror test: body against room, told by what turns along with the cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nico_selfmodel.experiments.experiment_report import Table
from nico_selfmodel.experiments.mirror_test.stage_document import stage_document
from nico_selfmodel.sessions.mirrors.acquaintance import Acquainted, rendered
from nico_selfmodel.sessions.progress import Stage, of_robot
from nico_selfmodel.sessions.turning import TORSO, TURNED, TurnedLook, look_while_turning
from nico_selfmodel.systems.closing import free_memory
from nico_selfmodel.vision.images.motion_mask import CELL
from nico_selfmodel.viz.figures.mirror_test.body_or_room_plot import body_or_room_plot

MOST_WRONG, LEAST_TOLD = 0.01, 0.5
"""Share of the cells that are told which may be told wrongly, and share of the body's that show
something which must be told, as the torso turns."""
ENOUGH = 5
"""Robots that a verdict takes."""
_SAID = {TORSO: ("body", "room"), "neck": ("head", "not the head")}
"""What stands still, and what does not, is called, by what is turned."""


@dataclass(frozen=True, eq=False)
class TurningStage:
    """What all robots told."""

    looks: dict[int, tuple[TurnedLook, ...]]
    """Of each robot: both cameras' as the torso turns, then as the neck does."""


def run_turning(robots: Sequence[Acquainted], progress: Stage | None = None) -> TurningStage:
    """Let robots hold their hand before their cameras, and turn torso and neck.

    Args:
        robots: Who they are.
    """
    looks = {}
    for i, robot in enumerate(robots):
        stage = of_robot(progress, i, len(robots))
        stage("telling its body from its room", 0, 1)
        nico = rendered(robot)
        q = nico.workspace.random_poses(1, np.random.default_rng((robot.seed, 50)))[0]
        arm = dict(zip(nico.arm.joints, q.tolist(), strict=True))
        looks[robot.seed] = look_while_turning(robot.world, robot.seed, arm)
        free_memory()
        stage("telling its body from its room", 1, 1)
    return TurningStage(looks)


def turning_document(stage: TurningStage) -> dict[str, Any]:
    """Return the stage as plain data, with its status."""
    rows = [_row(stage, turned) for turned in TURNED]
    told, wrong = (sum(row[key] for row in rows) for key in ("told", "wrong"))
    torso = rows[0]
    failed = []
    if wrong > MOST_WRONG * told:
        failed.append(f"{wrong} of {told} cells are told wrongly, at most {MOST_WRONG:.0%} may be")
    if torso["body_told"] < LEAST_TOLD * torso["body"]:
        failed.append(
            f"{torso['body_told']} of {torso['body']} cells of the body are told, "
            f"{LEAST_TOLD:.0%} are needed"
        )
    said = (
        f"{told - wrong} of {told} cells are told rightly, {torso['body_told']} of "
        f"{torso['body']} of the body"
    )
    few = len(stage.looks) < ENOUGH
    lacking = f"{len(stage.looks)} of {ENOUGH} robots that are needed: {said}" if few else None
    return stage_document("1c", "body against room", failed, lacking, said, turned=rows)


def _row(stage: TurningStage, turned: str) -> dict[str, Any]:
    """Count the cells of all looks at what was turned; of those that show something."""
    looks = [one for own in stage.looks.values() for one in own if one.turned == turned]

    def count(cells: str) -> int:
        return int(sum(_cells(one)[cells].sum() for one in looks))

    return {
        "turned": turned,
        "stands_still": _SAID[turned][0],
        "looks": len(looks),
        "cells": int(sum(one.shows.sum() for one in looks)),
        "told": count("told"),
        "wrong": count("wrong"),
        "body": count("body"),
        "body_told": count("body_told"),
        "room": count("room"),
        "room_told": count("room_told"),
    }


def _cells(look: TurnedLook) -> dict[str, Any]:
    """Return cells of one look of which is known what they show; the body's rim is neither."""
    body, room = look.body_true & look.shows, look.room_true & look.shows
    wrong = (look.told.body & room) | (look.told.room & body)
    body_told, room_told = look.told.body & body, look.told.room & room
    told = wrong | body_told | room_told
    return {
        "told": told,
        "wrong": wrong,
        "body": body,
        "body_told": body_told,
        "room": room,
        "room_told": room_told,
    }


def turning_table(stage: TurningStage) -> Table:
    """Return a row for torso and neck."""
    headings = (
        "turned", "stands still", "looks", "cells that show something", "of the body, told",
        "of the room, told", "wrong",
    )  # fmt: skip
    rows = [
        [
            row["turned"],
            row["stands_still"],
            str(row["looks"]),
            str(row["cells"]),
            f"{row['body_told']} of {row['body']}",
            f"{row['room_told']} of {row['room']}",
            str(row["wrong"]),
        ]
        for row in turning_document(stage)["turned"]
    ]
    return Table("Stage 1c: body against room", headings, rows, "\n")


def turning_chart(stage: TurningStage) -> Any:
    """Draw the left camera's looks of the first robot."""
    own = [one for one in next(iter(stage.looks.values())) if one.side == "left"]
    looks = {
        f"the {one.turned} turns: what stands still is {_SAID[one.turned][0]}": (
            one.picture, one.told.body, one.told.room,
        )
        for one in own
    }  # fmt: skip
    words = ("stands still", "moves")
    return body_or_room_plot(looks, CELL, words, "What turns along with the cameras is the body")
