"""One simulated whole Nico that looks at a room and at its hands through rendered pictures."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.dataset.body.conversion import tree_dataset_of
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_tree import WORLD, Attached
from nico_selfmodel.planning.body_poses import BodyView
from nico_selfmodel.planning.plans import Plan, commands_of_angles, given_commands
from nico_selfmodel.planning.visible_workspace import RENDERED
from nico_selfmodel.recording.session import Progress, record
from nico_selfmodel.sessions.whole_body import (
    IN_ROOM,
    camera_infos,
    cards_about_nico,
    link_joints_of,
    marker_infos,
    room_about_nico,
)
from nico_selfmodel.systems.looking import ARM_JOINTS, HEAD_JOINTS, looking_body
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections, imperfections_named
from nico_selfmodel.systems.stations.nico_station import NicoStation, room_detectors
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.stations.whole_nico import WholeNico
from nico_selfmodel.systems.tracking.shared_search import corner_names

QUICK = ImageQuality(supersample=1)
"""A room fills its pictures, so that rendering takes long; corners are then found to 0.08 px."""


class RenderedBody:
    """A whole Nico with cards of markers about it: its plans, its stations of several days."""

    def __init__(
        self,
        world: Imperfections | str,
        seed: int,
        arms: Sequence[str] = ("right", "left"),
        quality: ImageQuality | None = None,
    ) -> None:
        """Take a robot whose head turns.

        Args:
            world: What is wrong with it.
            seed: Which one.
            arms: Which arms move too: `right`, `left`.
            quality: Of the pictures; `QUICK` if omitted.
        """
        self.world, self.seed, self.arms = world, seed, tuple(arms)
        self.quality = quality or QUICK
        moving = (joint for side in self.arms for joint in ARM_JOINTS[side])
        self.body = looking_body(*HEAD_JOINTS, *moving)
        self.cards, self.room = cards_about_nico(), room_about_nico()
        places = [card.X_WK for card in self.cards for _ in card.ids]
        hung = [
            Attached(name, WORLD, _at(X_WK, p))
            for (name, p), X_WK in zip(self.room.items(), places, strict=True)
        ]
        self.view = BodyView(self.body, hung, RENDERED)

    @property
    def ground_truth(self) -> WholeNico:
        """What only the simulation knows: for judging and for tests, never for learning."""
        flaws = self.world
        flaws = imperfections_named(flaws) if isinstance(flaws, str) else flaws
        return WholeNico.build(self.body, flaws, self.seed, NICO_CAMERAS)

    @property
    def hands(self) -> dict[str, str]:
        """The marker of each hand, by arm."""
        return {side: f"{side}_hand_fiducial" for side in self.arms}

    @property
    def tracked(self) -> tuple[str, ...]:
        """Names of what is looked for in pictures: corners of the hands' markers, then the room."""
        corners = (name for hand in self.hands.values() for name in corner_names(hand))
        return (*corners, *self.room)

    def plan(self, looks: int, hands: int, rng: np.random.Generator) -> NDArray:
        """Draw poses in which the robot as described would see what is wanted.

        Args:
            looks: Poses in which both cameras see some of the room.
            hands: Poses of each hand before both cameras, some of the room beside it.
            rng: Source of the draws.

        Returns:
            Angles of the commanded joints [rad]. Shape (N, k).

        Raises:
            ModelError: If hardly any pose shows it: the head sees nothing of a hand.
        """
        room = list(self.room)
        poses = [self.view.poses(room, IN_ROOM, looks, rng)] if looks else []
        wanted = self.hands.values() if hands else ()
        poses += [self.view.poses([h], 1, hands, rng, also=(room, IN_ROOM)) for h in wanted]
        return np.vstack(poses) if poses else np.zeros((0, len(self.body.joints)))

    def record(
        self,
        name: str,
        session: int,
        looks: int,
        hands: int,
        *,
        rig: StereoRig | None = None,
        poses: NDArray | None = None,
        progress: Progress | None = None,
    ) -> BodyDataset:
        """Let it look about the room, then at its hands.

        Args:
            name: Of the recording.
            session: Which day.
            looks: Poses in which only the room is wanted.
            hands: Poses of each hand.
            rig: Calibrated cameras, behind whose lenses markers are located; as designed if
                omitted.
            poses: Visited instead [encoder units]. Shape (N, k).
            progress: Called after each pose.

        Returns:
            What its cameras saw of room and hands; places of the room's markers are known, lenses
            and places of everything else are not.

        Raises:
            ModelError: If hardly any pose shows a hand.
            DataError: If nothing was seen.
            ValueError: If a given pose lies beyond a joint's stop.
        """
        found = room_detectors(self.cards, rig or NICO_CAMERAS)
        rng = np.random.default_rng((self.seed, session, 26))
        angles = self.plan(*((looks, hands) if poses is None else (0, 0)), rng)
        with NicoStation(
            self.world,
            self.seed,
            session,
            arm=self.body,
            detectors={marker: found[marker] for marker in self.tracked},
            quality=self.quality,
            room=self.cards,
        ) as station:
            body = StationBody(station, station.joints, self.tracked)
            lower, upper = self.body.lower, self.body.upper
            planned = commands_of_angles(station.joints, lower, upper, angles)
            plan: Plan = given_commands(station.joints, planned if poses is None else poses)
            world, image_size = station.world.name, station.image_size
            source = f"rendered whole nico, world {world!r}, individual {self.seed}, "
            data = record(
                body,
                plan,
                name,
                source=f"{source}session {session}",
                seed=self.seed,
                image_size=image_size,
                until_seen=1,
                progress=progress,
            )
        return self._of_the_body(data)

    def _of_the_body(self, data: Dataset) -> BodyDataset:
        """Say what carries joints, markers and cameras; lenses and their places are not told."""
        tree = self.view.tree
        card = {own: hand for hand in self.hands.values() for own in corner_names(hand)}
        on = [tree.markers[tree.marker_index(card.get(name, name))] for name in self.tracked]
        tracked = [replace(one, name=name) for one, name in zip(on, self.tracked, strict=True)]
        infos = marker_infos(tree.with_markers(tuple(tracked)), self.room)
        links = [link for link in link_joints_of(tree) if link.name in self.body.joints]
        cameras = [replace(info, lens=None) for info in camera_infos(tree)]
        return tree_dataset_of(data, links, infos, cameras)


def _at(X_WK: NDArray, p: NDArray) -> NDArray:
    X = X_WK.copy()
    X[:3, 3] = p
    return X
