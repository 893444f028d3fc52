"""What a whole Nico is recorded with: cards of markers about it, poses to see them and hands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.conversion import tree_dataset_of, with_lenses
from nico_selfmodel.dataset.body.of_tree import camera_infos, link_joints_of, marker_infos
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.model.tree.body_tree import WORLD, Attached
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.head_following import HeadFollowing
from nico_selfmodel.planning.known_head import with_known_head
from nico_selfmodel.planning.plans import angles_of_commands, commands_of_angles
from nico_selfmodel.planning.visible_workspace import RENDERED
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.sessions.whole_body import IN_ROOM, cards_about_nico
from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS, looking_body
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.stations.nico_detectors import room_detectors, room_mirror_detectors
from nico_selfmodel.systems.tracking.hand_tracker import Detectors, MirrorDetectors
from nico_selfmodel.systems.tracking.shared_search import corner_names
from nico_selfmodel.vision.markers.tag_card import TagCard, markers_of


@dataclass(frozen=True, eq=False)
class WholeRecording:
    """A whole Nico, simulated or real, that looks at a room and at its hands."""

    arms: tuple[str, ...] = ("right", "left")
    """Which arms move beside the head: `right`, `left`, none."""
    cards: tuple[TagCard, ...] = field(default_factory=cards_about_nico)
    """Cards that hang about it, in the frame of its root link; five if omitted."""

    @cached_property
    def body(self) -> BodyDescription:
        """The body as described; its head and arms are commanded."""
        moving = (joint for side in self.arms for joint in ARM_JOINTS[side])
        return looking_body(*HEAD_JOINTS, *moving)

    @cached_property
    def room(self) -> dict[str, NDArray]:
        """Where the cards' markers are, by name [m]. Shape (3,) each."""
        return {name: p for name, (_, p) in markers_of(self.cards).items()}

    @cached_property
    def view(self) -> BodyView:
        """What its cameras would see, if it were as described."""
        return self.view_of(self.body)

    def view_of(self, body: BodyDescription) -> BodyView:
        """Return what its cameras would see, if it were so."""
        names = iter(self.room)
        hung = [
            Attached(next(names), WORLD, transform(card.X_WK[:3, :3], p))
            for card in self.cards
            for p in card.p_WT
        ]
        return BodyView(body, hung, RENDERED)

    @property
    def hands(self) -> dict[str, str]:
        """The marker of each hand, by arm."""
        return {side: f"{side}_hand_fiducial" for side in self.arms}

    @property
    def tracked(self) -> tuple[str, ...]:
        """Names of what is looked for in pictures: corners of the hands' markers, then the room."""
        corners = (name for hand in self.hands.values() for name in corner_names(hand))
        return (*corners, *self.room)

    def detectors(self, rig: StereoRig | None = None) -> Detectors:
        """Return what finds all that in pictures.

        Args:
            rig: Calibrated cameras, behind whose lenses markers are located; as designed if
                omitted.
        """
        found = room_detectors(self.cards, rig or NICO_CAMERAS)
        return {marker: found[marker] for marker in self.tracked}

    def mirror_detectors(self, rig: StereoRig | None = None) -> MirrorDetectors:
        """Return what finds all that in pictures, and its reflections.

        Args:
            rig: As in `detectors`.
        """
        found = room_mirror_detectors(self.cards, rig or NICO_CAMERAS)
        return {marker: found[marker] for marker in self.tracked}

    def plan(
        self, looks: int, hands: int, rng: np.random.Generator, body: BodyDescription | None = None
    ) -> NDArray:
        """Draw poses in which the robot, as far as it knows itself, would see what is wanted.

        Args:
            looks: Poses in which both cameras see some of the room.
            hands: Poses of each hand, which the head follows, some of the room beside it.
            body: What is known of it, see `known`; as described if omitted.

        Returns:
            Angles of the commanded joints [rad]. Shape (N, k).

        Raises:
            ModelError: If hardly any pose shows it: the head sees nothing of a hand.
        """
        view = self.view if body is None else self.view_of(body)
        room = list(self.room)
        poses = [view.poses(room, IN_ROOM, looks, rng)] if looks else []
        for hand in self.hands.values() if hands else ():
            head = HeadFollowing(view, hand, (room, IN_ROOM), rng)
            poses.append(view.poses([hand], 1, hands, rng, also=head.beside, turned=head.turned))
        return np.vstack(poses) if poses else np.zeros((0, len(self.body.joints)))

    def known(self, learned: BodyModel | None, joints: Sequence[JointInfo]) -> BodyDescription:
        """Return what is known of the body: its description, with its head as it was learned.

        Args:
            learned: A body of its head, or of more; None where nothing was learned.
            joints: The robot's, with stops.

        Raises:
            ModelError: If a camera, or a joint that turns one, was not learned.
        """
        return self.body if learned is None else with_known_head(self.body, learned, joints)

    def commands(self, joints: Sequence[JointInfo], angles: NDArray) -> NDArray:
        """Return commands that bring joints to angles [encoder units].

        Args:
            joints: The robot's, with stops.
            angles: Of its joints [rad]. Shape (N, k).
        """
        return commands_of_angles(joints, self.body.lower, self.body.upper, angles)

    def angles(self, joints: Sequence[JointInfo], commands: NDArray) -> NDArray:
        """Return the described joints' angles that commands stand for [rad].

        Args:
            joints: The robot's, with stops.
            commands: Of its joints [encoder units]. Shape (N, k).
        """
        return angles_of_commands(joints, self.body.lower, self.body.upper, commands)

    def dataset(self, data: Dataset, lenses: Mapping[str, Camera] | None = None) -> BodyDataset:
        """Say what carries joints, markers and cameras of what was recorded.

        Args:
            data: Of its joints, and what is tracked.
            lenses: Each camera's, by name; not told if omitted.

        Returns:
            The same measurements; places of the room's markers are known, those of cameras and
            hands are not.
        """
        tree = self.view.tree
        card = {own: hand for hand in self.hands.values() for own in corner_names(hand)}
        on = [tree.markers[tree.marker_index(card.get(name, name))] for name in self.tracked]
        tracked = [replace(one, name=name) for one, name in zip(on, self.tracked, strict=True)]
        infos = marker_infos(tree.with_markers(tuple(tracked)), self.room)
        links = [link for link in link_joints_of(tree) if link.name in self.body.joints]
        found = tree_dataset_of(data, links, infos, camera_infos(tree))
        return found if lenses is None else with_lenses(found, lenses)
