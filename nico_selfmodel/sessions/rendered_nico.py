"""One simulated Nico that can be recorded, day after day, through rendered pictures."""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.cameras.rig_parameters import SIDES
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.planning.board_poses import board_poses
from nico_selfmodel.planning.plans import Plan, given_commands
from nico_selfmodel.planning.visible_workspace import SPARE, VisibleWorkspace
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording.observed_body import ObservedBody
from nico_selfmodel.recording.session import record
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import Imperfections, imperfections_named
from nico_selfmodel.systems.stations.nico_detectors import default_detectors
from nico_selfmodel.systems.stations.nico_instance import NicoInstance
from nico_selfmodel.systems.stations.nico_station import BOARD, NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.systems.tracking.hand_tracker import FIDUCIAL_ID
from nico_selfmodel.systems.tracking.shared_search import corner_names, fiducial_detectors
from nico_selfmodel.vision.boards.chessboard import find_chessboard
from nico_selfmodel.vision.images.image_file import write_image
from nico_selfmodel.vision.images.not_seen import NotSeen

FIDUCIAL = "fiducial"
"""The point that is the middle of the marker on the hand."""
WINDOW = 5
"""Half side of the window in which corners are refined: squares are as small as 16 px."""


class RenderedNico:
    """One simulated Nico that can be recorded: its plans, its stations of several days."""

    def __init__(
        self,
        world: Imperfections | str,
        seed: int,
        markers: tuple[str, ...] = ("fiducial", "finger_tip"),
        quality: ImageQuality | None = None,
        arm: ArmDescription | None = None,
        *,
        corners: bool = False,
    ) -> None:
        """Take a robot.

        Args:
            seed: Which one.
            markers: What is tracked, some of the arm's points.
            arm: The arm, if it is another one: of six joints, with a tool in hand.
            corners: Locate the corners of the fiducial too, which tell how the hand is turned.
        """
        self.world, self.seed, self.markers, self.quality = world, seed, markers, quality
        self.arm: ArmDescription = arm or looking_arm(*markers)
        self.workspace = VisibleWorkspace.of(self.arm, markers)
        self.corners = corner_names(FIDUCIAL) if corners else ()

    @property
    def ground_truth(self) -> GroundTruth:
        """What only the simulation knows: for judging and for tests, never for learning."""
        flaws = imperfections_named(self.world)
        return NicoInstance.build(self.arm, flaws, self.seed, NICO_CAMERAS).ground_truth

    @property
    def tracked(self) -> tuple[str, ...]:
        """Names of all that is located on the hand."""
        return (*self.markers, *self.corners)

    def station(self, session: int, rig: StereoRig | None = None) -> NicoStation:
        """Return its station of a day; calibrated cameras locate fiducials behind their lenses."""
        found = default_detectors(rig)
        if self.corners:
            # One search of a picture for all.
            own = {FIDUCIAL: FIDUCIAL_ID}
            found = {**found, **fiducial_detectors(own, own, rig=rig)}
        detectors = {marker: found[marker] for marker in self.tracked}
        return NicoStation(
            self.world,
            self.seed,
            session,
            arm=self.arm,
            detectors=detectors,
            quality=self.quality,
            near_marks=True,
        )

    def plan(
        self,
        station: NicoStation,
        circle: int,
        free: int,
        rng: np.random.Generator,
        spare: float = SPARE,
    ) -> Plan:
        """Plan circles and free poses, some to spare."""
        return self.workspace.plan(station.joints, circle, free, rng, spare)

    def record(
        self,
        name: str,
        session: int,
        circle: int,
        free: int,
        *,
        rig: StereoRig | None = None,
        folder: Path | None = None,
        keep_images: bool = False,
        observed: bool = False,
        poses: NDArray | None = None,
        spare: float = SPARE,
        progress: Callable[[int, int], None] | None = None,
    ) -> Dataset:
        """Record circles and free poses.

        Args:
            session: Which day.
            circle: Poses on circles.
            free: Free poses.
            rig: Calibrated cameras, if known.
            folder: Where to keep samples from the first one on; resumed if it is there.
            observed: Let ground truth measure the hand too, in the left camera's frame.
            poses: Visited instead of random ones [encoder units]. Shape (N, n).
            spare: Free poses planned for each that is wanted: no more are visited than it takes.

        Raises:
            ValueError: If a given pose lies beyond a joint's stop.
        """
        with self.station(session, rig) as station:
            body = StationBody(station, station.joints, self.tracked, keep_images=keep_images)
            rng = np.random.default_rng((self.seed, session, 2))
            plan = self.plan(station, circle, free if poses is None else 0, rng, spare)
            if poses is not None:
                plan += given_commands(station.joints, poses)
            return record(
                _observed(body, station) if observed else body,
                plan,
                name,
                source=station.world.origin("rendered nico", self.seed, session),
                seed=self.seed,
                image_size=station.image_size,
                until_seen=2,
                enough=free if poses is None else None,
                folder=folder,
                progress=progress,
            )

    def board_views(
        self,
        count: int,
        session: int = 0,
        *,
        folder: Path | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> BoardViews:
        """Hold the chessboard before the cameras, and find its corners.

        Args:
            count: Views in which both cameras find it.
            session: Which day.
            folder: Where to keep the pictures, as `left01.png` and `right01.png`; it must exist.

        Raises:
            DataError: If the board is hardly ever found.
        """
        rng = np.random.default_rng((self.seed, session, 8))
        poses = board_poses(self.workspace, BOARD, 3 * count, rng)
        pixels: list[NDArray] = []
        with self.station(session) as station:
            size = station.image_size
            for pair in _pictures(station, poses):
                left, right = (find_chessboard(image, BOARD, WINDOW) for image in pair)
                if isinstance(left, NotSeen) or isinstance(right, NotSeen):
                    continue
                if left.loose or right.loose:
                    continue
                same = BOARD.same_order(left.corners, right.corners)
                pixels.append(np.hstack([left.corners, same]))
                for camera, image in zip(SIDES, pair, strict=True):
                    if folder is not None:
                        write_image(folder / f"{camera}{len(pixels):02d}.png", image)
                if progress:
                    progress(len(pixels), count)
                if len(pixels) == count:
                    break
        if len(pixels) < max(count, 1):
            raise DataError(
                f"the {BOARD} board was found in {len(pixels)} of {3 * count} pairs of pictures, "
                f"{count} are wanted"
            )
        names = tuple(f"{i + 1:02d}" for i in range(count))
        return BoardViews(BOARD.points, names, SIDES, np.array(pixels), (size, size))


def _observed(body: StationBody, station: NicoStation) -> ObservedBody:
    """Let the station's motion capture measure the hand, in the true left camera's frame."""
    truth, port = station.ground_truth, station.GetOutputPort("p_WH_measured")

    def locate() -> NDArray:
        return truth.locate(np.array(port.Eval(body.context), dtype=float).reshape(-1, 3))

    return ObservedBody(body, locate, cameras=2)


def _pictures(station: NicoStation, board_poses: Iterable[NDArray]) -> Iterator[list[NDArray]]:
    """Hold a chessboard before the cameras, and give what both see of it."""
    context = station.CreateDefaultContext()
    for second, X_BG in enumerate(board_poses):
        context.SetTime(float(second))
        station.hold_board(context, X_BG)
        yield [station.picture(context, camera) for camera in SIDES]
