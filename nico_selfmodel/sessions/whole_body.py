"""One recording of a simulated whole Nico that looks about a room and at its own hands."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.conversion import tree_dataset_of, with_lenses
from nico_selfmodel.dataset.body.of_tree import camera_infos, link_joints_of, marker_infos
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.tree.body_tree import WORLD, Attached, BodyTree
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.head_following import HeadFollowing
from nico_selfmodel.planning.plans import commands_of_angles
from nico_selfmodel.recording.session import Progress, record
from nico_selfmodel.systems.looking import ARM_JOINTS, looking_body
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.instance import RobotInstance
from nico_selfmodel.systems.simulated.robot import SimulatedRobot
from nico_selfmodel.systems.simulated.sensors import StereoPixels
from nico_selfmodel.systems.stations.whole_nico import WholeNico
from nico_selfmodel.vision.markers.tag_card import TagCard, markers_of

_FACE = np.array([0.085, 0.0, 0.48])
"""About where the cameras of a Nico are that looks straight ahead, in its root link's frame [m]."""
_CARDS = (
    (0.0, -0.3, 0.7), (0.8, -0.2, 0.8), (-0.8, -0.2, 0.8), (0.4, 0.4, 0.9), (-0.4, 0.4, 0.9),
)  # fmt: skip
"""Cards about it: to the left [rad], up [rad], away [m]."""
_SPACING = 0.12
"""From marker to marker of a card [m]."""
_FIRST_ID = 20
"""Of the cards' markers; Nico's hands have 7 and 8."""
IN_ROOM = 6
"""Markers of the room that both cameras shall see in every pose."""


def cards_about_nico() -> tuple[TagCard, ...]:
    """Return five cards of six markers about Nico, in its root link's frame."""
    out = []
    for card, (left, up, away) in enumerate(_CARDS):
        way = np.array([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)])
        x = np.cross([0.0, 0.0, 1.0], -way)
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(-way, x), -way]) @ rotation_from_vector([0.5, 0.3, 0.0])
        X_WK = transform(R, _FACE + away * way)
        out.append(TagCard(_FIRST_ID + 6 * card, X_WK, pitch=_SPACING))
    return tuple(out)


def room_about_nico() -> dict[str, NDArray]:
    """Return the markers of these cards, in Nico's root link's frame [m]. Shape (3,) each."""
    return {name: p for name, (_, p) in markers_of(cards_about_nico()).items()}


def whole_nico(world: Imperfections, seed: int) -> tuple[WholeNico, BodyTree]:
    """Return a Nico, and its true body in the frame of the room, the room's markers with it."""
    nico = WholeNico.build(looking_body(), world, seed, NICO_CAMERAS)
    mechanics = nico.mechanics.in_room(attached_in_room(room_about_nico()))
    return replace(nico, mechanics=mechanics), mechanics.tree


def whole_body_session(
    world: Imperfections,
    seed: int,
    session: int,
    *,
    looks: int,
    hands: int,
    name: str | None = None,
    pixel_sigma: float = 0.3,
    progress: Progress | None = None,
) -> BodyDataset:
    """Record a whole Nico: its head turns before a known room, then each hand before its cameras.

    Poses are those in which the robot as described would see what is wanted, its head following the
    hand; what hides markers is not simulated. The room stands still, and the places of its markers
    are known.

    Args:
        seed: Which robot.
        session: Of poses and noise.
        looks: Poses in which only the room is wanted.
        hands: Poses of each hand before both cameras, some of the room seen beside it.
        name: Of the recording; robot and session if omitted.
        pixel_sigma: Noise of a pixel coordinate [px].

    Returns:
        The recording; lenses are told as they are, as calibrated cameras know them.

    Raises:
        ValueError: If no pose is wanted.
    """
    if looks + hands < 1:
        raise ValueError(f"nothing to record: looks and hands must not both be 0, got {looks}")
    nico, tree = whole_nico(world, seed)
    room = room_about_nico()
    rng = np.random.default_rng((seed, session, 24))
    view = BodyView(nico.body, attached_in_room(room))
    poses = [view.poses(list(room), IN_ROOM, looks, rng)] if looks else []
    for side in ARM_JOINTS if hands else ():
        own = [f"{side}_hand_fiducial", f"{side}_finger_tip"]
        head = HeadFollowing(view, own[0], (list(room), IN_ROOM), rng)
        drawn = view.poses(own, len(own), hands, rng, also=head.beside, turned=head.turned)
        poses.append(drawn)
    robot = SimulatedRobot(
        RobotInstance(nico.mechanics, X_TB=nico.X_TB),
        StereoPixels(pixel_sigma),
        (seed, session, 25),
    )
    commands = commands_of_angles(robot.joints, nico.body.lower, nico.body.upper, np.vstack(poses))
    dataset = record(
        robot,
        [("", command) for command in commands],
        name or f"whole_nico_{seed}_{session}",
        source=world.origin("simulated whole nico", seed, session),
        seed=seed,
        progress=progress,
    )
    return seen_by(tree, room, dataset)


def seen_by(tree: BodyTree, room: Mapping[str, NDArray], dataset: Dataset) -> BodyDataset:
    """Return what a body saw of itself and of a room, its lenses told as they are."""
    infos = link_joints_of(tree), marker_infos(tree, room), camera_infos(tree)
    return with_lenses(tree_dataset_of(dataset, *infos), tree.lenses)


def attached_in_room(room: Mapping[str, NDArray]) -> list[Attached]:
    """Return markers fixed in the room, by their places [m]. Shape (3,) each."""
    return [
        Attached(name, WORLD, transform(np.eye(3), p), oriented=False) for name, p in room.items()
    ]
