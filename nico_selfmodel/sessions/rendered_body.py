"""One simulated whole Nico that looks at a room and at its hands through rendered pictures."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.body.body_dataset import BodyDataset
from nico_selfmodel.model.cameras.camera import Camera
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.planning.plans import Plan, given_commands
from nico_selfmodel.recording.session import Body, Progress, record
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.imperfections import Imperfections, imperfections_named
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.stations.whole_nico import WholeNico

QUICK = ImageQuality(supersample=1)
"""A room fills its pictures, so that rendering takes long; corners are then found to 0.08 px."""


@dataclass(frozen=True, eq=False)
class RenderedBody:
    """A simulated whole Nico with cards of markers about it: its stations of several days."""

    world: Imperfections | str
    """What is wrong with it."""
    seed: int
    """Which one."""
    whole: WholeRecording
    """What it is recorded with."""
    quality: ImageQuality = QUICK
    """Of the pictures."""

    @property
    def ground_truth(self) -> WholeNico:
        """What only the simulation knows: for judging and for tests, never for learning."""
        flaws = imperfections_named(self.world)
        return WholeNico.build(self.whole.body, flaws, self.seed, NICO_CAMERAS)

    def station(
        self, session: int, rig: StereoRig | None = None, mirror: MirrorPlate | None = None
    ) -> NicoStation:
        """Wake it up in its room.

        Args:
            session: Which day.
            rig: Calibrated cameras, behind whose lenses markers are located; as designed if
                omitted.
            mirror: A mirror that can be put somewhere, if any; reflections are then located too.
        """
        whole = self.whole
        return NicoStation(
            self.world,
            self.seed,
            session,
            arm=whole.body,
            detectors=whole.detectors(rig) if mirror is None else whole.mirror_detectors(rig),
            quality=self.quality,
            mirror=mirror,
            room=whole.cards,
        )

    def record(
        self,
        name: str,
        session: int,
        looks: int,
        hands: int,
        *,
        lenses: Mapping[str, Camera] | None = None,
        learned: BodyModel | None = None,
        poses: NDArray | None = None,
        progress: Progress | None = None,
        watch: Callable[[StationBody], Body] | None = None,
    ) -> BodyDataset:
        """Let it look about the room, then at its hands.

        Args:
            session: Which day.
            looks: Poses in which only the room is wanted.
            lenses: Calibrated cameras by name, behind whose lenses markers are located; as
                designed, and not told, if omitted.
            learned: What was learned of its head, by which poses are planned; as described if
                omitted.
            poses: Visited instead [encoder units]. Shape (N, k).
            watch: Stands between it and the recording, which then has its pictures, if given.

        Returns:
            What its cameras saw of room and hands, see `WholeRecording.dataset`.

        Raises:
            ModelError: If hardly any pose shows a hand.
            DataError: If nothing was seen.
            ValueError: If a given pose lies beyond a joint's stop.
        """
        whole, rng = self.whole, np.random.default_rng((self.seed, session, 26))
        with self.station(session, None if lenses is None else StereoRig(*lenses.values())) as nico:
            body = StationBody(nico, nico.joints, whole.tracked, keep_images=watch is not None)
            if poses is None:
                known = whole.known(learned, nico.joints)
                poses = whole.commands(nico.joints, whole.plan(looks, hands, rng, known))
            plan: Plan = given_commands(nico.joints, poses)
            data = record(
                body if watch is None else watch(body),
                plan,
                name,
                source=nico.world.origin("rendered whole nico", self.seed, session),
                seed=self.seed,
                image_size=nico.image_size,
                until_seen=1,
                progress=progress,
            )
        return whole.dataset(data, lenses)
