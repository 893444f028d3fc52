"""One simulated Nico that can be recorded, day after day, through rendered pictures."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset import BoardViews, Dataset, JointInfo
from nico_selfmodel.errors import DataError
from nico_selfmodel.experiments.outsider import ObservedBody, Outsider
from nico_selfmodel.model import StereoRig
from nico_selfmodel.model.stereo_rig import EYES
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.recording import (
    Plan,
    commands_of_angles,
    given_commands,
    pose_plan,
    record,
)
from nico_selfmodel.systems import (
    BOARD,
    ImageQuality,
    Imperfections,
    NicoStation,
    StationBody,
    VisibleWorkspace,
    default_detectors,
    looking_arm,
)
from nico_selfmodel.vision import NotSeen, find_chessboard, write_image

SPARE = 1.25
"""Poses planned for each that is wanted: some hide the marker after all."""
HOME_REPEATS = 4
WINDOW = 5
"""Half side of the window in which corners are refined: squares are as small as 16 px."""


def plan_in_view(
    reach: VisibleWorkspace,
    joints: Sequence[JointInfo],
    circle: int,
    free: int,
    rng: np.random.Generator,
) -> Plan:
    """Plan circles and free poses in view of both eyes, some free ones to spare.

    Args:
        reach: The arm before its eyes as described.
        joints: Its joints with stops, which stand for the limits of the description.
        circle: Poses on circles, home not counted.
        free: Free poses wanted.
        rng: Source of the free poses.
    """
    arm, n = reach.arm, len(reach.arm.joints)

    def to(q: NDArray) -> NDArray:
        return commands_of_angles(joints, arm.lower, arm.upper, q)

    count = int(np.ceil(SPARE * free))
    poses = reach.random_poses(count, rng) if count else np.zeros((0, n))
    home, ends = reach.home_and_arcs() if circle else (arm.lower, np.zeros((n, 2)))
    return pose_plan(joints, to(home), to(ends.T).T, circle, to(poses), home_repeats=HOME_REPEATS)


class RenderedNico:
    """One simulated Nico that can be recorded: its plans, its stations of several days."""

    def __init__(
        self,
        world: Imperfections | str,
        seed: int,
        markers: tuple[str, ...] = ("fiducial", "finger_tip"),
        quality: ImageQuality | None = None,
        arm: ArmDescription | None = None,
    ) -> None:
        """Take an individual.

        Args:
            world: What is wrong with it.
            seed: Which one.
            markers: What is tracked.
            quality: Of the pictures.
            arm: The arm with these markers, if it is not as its maker left it: with a tool in hand.
        """
        self.world, self.seed, self.markers, self.quality = world, seed, markers, quality
        self.arm: ArmDescription = arm or looking_arm(*markers)
        self.reach = VisibleWorkspace.of(self.arm)

    def station(self, session: int, rig: StereoRig | None = None) -> NicoStation:
        """Return its station of one day; calibrated eyes locate fiducials behind their lenses."""
        found = default_detectors(rig)
        detectors = {marker: found[marker] for marker in self.markers}
        return NicoStation(
            self.world,
            self.seed,
            session,
            arm=self.arm,
            detectors=detectors,
            quality=self.quality,
        )

    def plan(self, station: NicoStation, circle: int, free: int, rng: np.random.Generator) -> Plan:
        """Plan circles and free poses, some to spare."""
        return plan_in_view(self.reach, station.joints, circle, free, rng)

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
        outsider: Outsider | None = None,
        poses: NDArray | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Dataset:
        """Record circles and free poses.

        Args:
            name: Name of the data set.
            session: Which day.
            circle: Poses on circles.
            free: Free poses.
            rig: Calibrated eyes, if known.
            folder: Where to keep samples from the first one on; resumed if it is there.
            keep_images: Keep the pictures in the folder.
            outsider: Who measures the hand too, in the left eye's frame, for judging only.
            poses: Visited instead of random ones [encoder units]. Shape (N, n).
            progress: Called after each pose.

        Returns:
            The data set.

        Raises:
            ValueError: If a given pose lies beyond a joint's stop.
        """
        with self.station(session, rig) as station:
            body = StationBody(station, station.joints, self.markers, keep_images=keep_images)
            rng = np.random.default_rng((self.seed, session, 2))
            plan = self.plan(station, circle, free if poses is None else 0, rng)
            if poses is not None:
                plan += given_commands(station.joints, poses)
            world = station.world.name
            return record(
                body if outsider is None else ObservedBody(body, station, outsider),
                plan,
                name,
                source=f"rendered nico, world {world!r}, individual {self.seed}, session {session}",
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
        """Hold the chessboard before the eyes, and find its corners.

        Args:
            count: Views in which both eyes find it.
            session: Which day.
            folder: Where to keep the pictures, as `left01.png` and `right01.png`; it must exist.
            progress: Called after each view.

        Returns:
            The corners.

        Raises:
            DataError: If the board is hardly ever found.
        """
        rng = np.random.default_rng((self.seed, session, 8))
        board_poses = self.reach.board_poses(BOARD, 3 * count, rng)
        pixels: list[NDArray] = []
        with self.station(session) as station:
            size = station.image_size
            for pair in _pictures(station, board_poses):
                left, right = (find_chessboard(image, BOARD, WINDOW) for image in pair)
                if isinstance(left, NotSeen) or isinstance(right, NotSeen):
                    continue
                same = BOARD.same_order(left.corners, right.corners)
                pixels.append(np.hstack([left.corners, same]))
                for eye, image in zip(EYES, pair, strict=True):
                    if folder is not None:
                        write_image(folder / f"{eye}{len(pixels):02d}.png", image)
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
        return BoardViews(BOARD.points, names, EYES, np.array(pixels), size)


def _pictures(station: NicoStation, board_poses: Iterable[NDArray]) -> Iterator[list[NDArray]]:
    """Hold a chessboard before the eyes, and give what both see of it."""
    context = station.CreateDefaultContext()
    for second, X_BG in enumerate(board_poses):
        context.SetTime(float(second))
        station.hold_board(context, X_BG)
        yield [station.picture(context, eye) for eye in EYES]
