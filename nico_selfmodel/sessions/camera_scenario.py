"""Nico learns its cameras from a chessboard and then its arm by watching its hand (chapter 7).

Everything goes through rendered pixels: boards, fiducial and red tape are found in pictures.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.board_views import BoardViews
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.arm.kinematics import KinematicCalibration, calibrate_kinematics
from nico_selfmodel.estimation.body.stereo_points import StereoPoints
from nico_selfmodel.estimation.cameras.camera_adjustment import CameraCalibration
from nico_selfmodel.estimation.cameras.camera_calibration import calibrate_cameras
from nico_selfmodel.estimation.cameras.camera_options import CameraOptions
from nico_selfmodel.estimation.initialization.nominal_arm import NominalArm
from nico_selfmodel.estimation.observations.pixel_evaluation import PixelEvaluation
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.planning.visible_workspace import SPARE
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.sessions.progress import Stage, telling
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.simulated.imperfections import Imperfections

MARKERS = {"stereo-fiducial": "fiducial", "stereo-color": "finger_tip"}
"""Sensor -> what it looks at."""
_TRIED = 60
"""Poses to judge by that are planned at least: where few show the hand, it may be in none of 15."""


@dataclass(frozen=True, eq=False)
class Counts:
    """How much is recorded."""

    boards: int = 16
    """Views of the chessboard."""
    circle: int = 60
    """Poses on circles, home not counted."""
    random: int = 100
    """Random poses to learn from."""
    test: int = 100
    """Random poses to judge by."""
    test_boards: int = 8
    """Views of the chessboard to judge cameras and arm by that were refined together."""


@dataclass(frozen=True, eq=False)
class ArmScenario:
    """An arm learned from pictures of one marker."""

    calibration: KinematicCalibration
    """Of the arm; its model has the cameras too."""
    stereo: StereoPoints
    """What the cameras saw of the marker, to learn from and held out."""
    seen: PixelEvaluation
    """The model against the held-out pictures, in the image and in space (eq. 7.4)."""

    @property
    def train(self) -> Dataset:
        """Rows of the marker with pixels."""
        return self.stereo.pixels["train"]

    @property
    def test(self) -> Dataset:
        """Held-out rows."""
        return self.stereo.pixels["test"]

    @property
    def model(self) -> SelfModel:
        """Arm and cameras, in the left camera's frame."""
        return self.calibration.model


@dataclass(frozen=True, eq=False)
class CameraScenario:
    """Cameras and arm, as learned."""

    views: BoardViews
    """What was seen of the chessboard."""
    cameras: CameraCalibration
    """The cameras."""
    arms: Mapping[str, ArmScenario]
    """Marker -> the arm learned by it."""
    up: NDArray | None = None
    """The vertical in the left camera's frame, as the robot is described. Shape (3,)."""


@dataclass(frozen=True, eq=False)
class WatchedHand:
    """What a robot saw of a chessboard, and then of its hand."""

    views: BoardViews
    """What was seen of the chessboard."""
    cameras: CameraCalibration
    """The cameras, calibrated by it."""
    train: Dataset
    """The hand, to learn from."""
    test: Dataset
    """The same, held out."""


def learn_cameras_and_arm(
    world: Imperfections | str,
    seed: int = 0,
    *,
    markers: tuple[str, ...] = ("fiducial",),
    counts: Counts | None = None,
    stage: Stage | None = None,
) -> CameraScenario:
    """Calibrate the cameras, move the arm before them, and learn it.

    Args:
        seed: Which robot.
        markers: What is tracked on the hand: `fiducial`, `finger_tip` or both at once.
    """
    nico = RenderedNico(world, seed, markers)
    seen = watch_hand(nico, counts, stage)
    telling(stage, "learning the arm")(0, len(markers))
    arms = {}
    for done, marker in enumerate(markers, start=1):
        train, test = (of_marker(one, marker) for one in (seen.train, seen.test))
        nominal, up = nominal_with(nico.arm, marker), nico.workspace.up_C
        arms[marker] = learn_arm(train, test, seen.cameras, nominal, "nico", up)
        telling(stage, "learning the arm")(done, len(markers))
    return CameraScenario(seen.views, seen.cameras, arms, nico.workspace.up_C)


def watch_hand(
    nico: RenderedNico,
    counts: Counts | None = None,
    stage: Stage | None = None,
    *,
    options: CameraOptions | None = None,
    observed: bool = False,
) -> WatchedHand:
    """Calibrate the cameras, and move the arm before them.

    Args:
        options: What of the cameras is held.
        observed: Whether what is held out has true places of the hand beside it.
    """
    counts = counts or Counts()
    views = nico.board_views(counts.boards, 0, progress=telling(stage, "looking at a chessboard"))
    telling(stage, "learning the cameras")(0, 1)
    cameras = calibrate_cameras(views, options)
    telling(stage, "learning the cameras")(1, 1)
    train = nico.record(
        "train",
        1,
        counts.circle,
        counts.random,
        rig=cameras.rig,
        progress=telling(stage, "moving every joint, watching the hand"),
    )
    test = nico.record(
        "test",
        2,
        0,
        counts.test,
        rig=cameras.rig,
        observed=observed,
        spare=max(SPARE, _TRIED / max(counts.test, 1)),
        progress=telling(stage, "new poses, kept for judging"),
    )
    return WatchedHand(views, cameras, train, test)


def learn_arm(
    train: Dataset,
    test: Dataset,
    cameras: CameraCalibration,
    nominal: NominalArm | None,
    name: str,
    up: NDArray | None = None,
) -> ArmScenario:
    """Learn an arm from what calibrated cameras reconstruct of its hand.

    Args:
        train: Rows of one marker with pixels.
        nominal: The robot as described, for the zero of its joints.
        up: The vertical in the left camera's frame, which the robot knows from its description to a
            degree or two; guessed where the arm sags if omitted. Shape (3,).
    """
    stereo = StereoPoints.of(cameras.self_model(name), train, test)
    calibration = stereo.complete(
        calibrate_kinematics(
            stereo.train,
            test=stereo.test,
            nominal=nominal,
            name=name,
            up=up,
            spread=stereo.spread,
        )
    )
    return ArmScenario(calibration, stereo, stereo.evaluate(calibration.model))


def of_marker(data: Dataset, marker: str) -> Dataset:
    """Return the rows of one marker that a camera saw."""
    seen = np.isfinite(data.pixels).any(axis=1)
    return data.select(seen & (data.marker == marker))


def nominal_with(arm: ArmDescription, marker: str) -> NominalArm:
    """Return the described arm with one of its points only."""
    k = arm.markers.index(marker)
    chain = replace(arm.chain, markers=(marker,), p_WH_zero=arm.chain.p_WH_zero[k : k + 1])
    return NominalArm(chain, arm.lower, arm.upper, arm.source)
