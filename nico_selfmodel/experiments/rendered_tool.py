"""A screwdriver in the hand of one Nico, its tip seen through rendered pictures."""

from pathlib import Path
from tempfile import TemporaryDirectory
from xml.dom.minidom import Element

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.experiments.rendered_scenario import COUNTS, MARKERS, rendered_scenarios
from nico_selfmodel.experiments.tool_use import COUNTS as TOOL_COUNTS
from nico_selfmodel.experiments.tool_use import TOOL, ToolScenario
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.urdf_document import (
    append,
    append_frame_link,
    children,
    document_text,
    numbers_text,
    read_document,
    robot_element,
)
from nico_selfmodel.sessions.camera_scenario import Counts, of_marker
from nico_selfmodel.sessions.progress import Stage
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.simulated.imperfections import Imperfections

_FINGER, _TIP, _TAPE = "right_finger_tip", "right_tool_tip", "red_tape"
_SHAFT = 0.003
"""Radius of the screwdriver's shaft [m]."""
_MARKER = MARKERS["color"]
_TEST_DAY, _TRAIN_DAY = 4, 5


def rendered_tool_scenario(
    world: Imperfections, seed: int, stage: Stage | None = None, counts: Counts = COUNTS
) -> ToolScenario:
    """Let one Nico learn itself by the tape on its finger, and then see a tool's tip.

    Args:
        seed: Which robot.
        counts: How much is recorded of the bare hand, and how many poses judge the tool.
    """
    tell = stage or (lambda *_: None)
    scenario = rendered_scenarios(world, seed, ("color",), stage, counts)["color"]
    model = calibrate_body(scenario.train, scenario.cameras, scenario.boards).model
    with TemporaryDirectory() as folder:
        arm = arm_with_tool(Path(folder))
        nico = RenderedNico(world, seed, (_MARKER,), arm=arm)
        shown = nico.record(
            "tip",
            _TEST_DAY,
            0,
            counts.test,
            rig=model.rig,
            observed=True,
            progress=lambda *done: tell("the tool, kept for judging", *done),
        )
        taken = nico.record(
            "tool",
            _TRAIN_DAY,
            0,
            TOOL_COUNTS[-1],
            rig=model.rig,
            progress=lambda *done: tell("moving the tool", *done),
        )
    hand, shown, taken = scenario.test, of_marker(shown, _MARKER), of_marker(taken, _MARKER)
    return ToolScenario(model, hand, taken, shown)


def arm_with_tool(folder: Path) -> ArmDescription:
    """Put a screwdriver into the robot's hand; the tape is on its tip and no longer on the finger.

    Args:
        folder: Where to write the robot with its tool.

    Returns:
        The arm before its cameras, the tip in the place of the marker on the finger.
    """
    arm = looking_arm(_MARKER)
    document = read_document(arm.urdf)
    robot = robot_element(document)
    _take_tape_off(robot)
    p_FT = arm.links.X_BH[0][:3, :3].T @ TOOL
    append_frame_link(robot, _TIP, _FINGER, transform(_along(p_FT), p_FT))
    tip = next(link for link in children(robot, "link") if link.getAttribute("name") == _TIP)
    length = float(np.linalg.norm(p_FT))
    visual = append(tip, "visual")
    append(visual, "origin", xyz=numbers_text([0.0, 0.0, -0.5 * length]))
    append(visual, "material", name="joint")
    shape = append(visual, "geometry")
    append(shape, "cylinder", radius=repr(_SHAFT), length=repr(length))
    urdf = folder / "nico_with_tool.urdf"
    urdf.write_text(document_text(document), encoding="utf-8")
    held, points = dict(arm.held), {_MARKER: _TIP}
    return ArmDescription.from_urdf(urdf, arm.base_link, arm.tip_link, held, points)


def _take_tape_off(robot: Element) -> None:
    """Remove the tape that the robot's file draws on the finger with the marker."""
    for link in children(robot, "link"):
        for visual in children(link, "visual"):
            taped = any(m.getAttribute("name") == _TAPE for m in children(visual, "material"))
            if taped and link.getAttribute("name").startswith("right_"):
                link.removeChild(visual)


def _along(way: NDArray) -> NDArray:
    """Return a rotation whose z axis points along a vector. Shape (3, 3)."""
    z = way / np.linalg.norm(way)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
