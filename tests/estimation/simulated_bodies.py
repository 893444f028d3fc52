"""Bodies that see their own hand, what they recorded, and their truth, which only tests may see."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.estimation.body.body import calibrate_body
from nico_selfmodel.estimation.body.body_calibration import BodyCalibration
from nico_selfmodel.estimation.body.body_options import BodyOptions
from nico_selfmodel.experiments.projected_nico import ProjectedNico
from nico_selfmodel.experiments.refinement import Scenario, simulated_scenario
from nico_selfmodel.model.arm.dh_parameters import DhParameters
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.systems.simulated.robot import SimulatedRobot

PLAY = IMPERFECTIONS["clean"].with_noise(play_deg=0.5)
CLEAN = IMPERFECTIONS["clean"]


@dataclass(frozen=True, eq=False)
class Truth:
    """What a simulated body keeps to itself, in the true left camera's frame."""

    parameters: DhParameters
    rig: StereoRig

    @classmethod
    def of(cls, body: SimulatedRobot) -> "Truth":
        model = body.ground_truth.model()
        return cls(DhParameters(model.dh, model.servos), body.ground_truth.rig)

    def model(self, **others) -> SelfModel:
        """Return the truth as a self-model."""
        cameras = {"left": self.rig.left, "right": self.rig.right}
        table, servos = self.parameters.table, self.parameters.servos
        return SelfModel("truth", table, servos, cameras=cameras, **others)


def protocol(tracker: str = "fiducial") -> ProjectedNico:
    return ProjectedNico.tracked_by(tracker)


def scenario(
    seed: int = 0, tracker: str = "fiducial", world=PLAY, random_poses: int = 100
) -> Scenario:
    """Return what one individual recorded: 61 poses on circles, 100 random ones, 100 to test."""
    return _scenario(seed, tracker, world, random_poses)


@cache
def _scenario(seed: int, tracker: str, world, random_poses: int) -> Scenario:
    return simulated_scenario(protocol(tracker), world, seed, random_poses)


def learned(
    seed: int = 0, tracker: str = "fiducial", stage: str = "full", variant: str = "anchored"
) -> BodyCalibration:
    """Return what one individual learned from its scenario."""
    return _learned(seed, tracker, stage, variant)


@cache
def _learned(seed: int, tracker: str, stage: str, variant: str) -> BodyCalibration:
    recorded = scenario(seed, tracker)
    return calibrate_body(
        recorded.train,
        recorded.cameras,
        recorded.boards,
        BodyOptions(stage, variant),
        test=recorded.test,
        test_boards=recorded.test_boards,
    )


def body(seed: int = 0, tracker: str = "fiducial", world=PLAY, session: int = 1) -> SimulatedRobot:
    return protocol(tracker).robot(world, seed, session)


def poses(one: SimulatedRobot, count: int, seed: int = 0, tracker: str = "fiducial", **others):
    """Return random poses of a body, with what was measured from outside."""
    drawn = protocol(tracker).random_poses(count, np.random.default_rng((seed, 40)), **others)
    return protocol(tracker).record(one, "poses", drawn, observed=True)


def only_cameras(dataset: Dataset) -> Dataset:
    """Return data without what was measured from outside."""
    return replace(dataset, p_WH_measured=np.full((len(dataset), 3), np.nan))


def blinded(dataset: Dataset, rows, camera: int) -> Dataset:
    """Return data in which a camera did not see some rows."""
    pixels = dataset.pixels.copy()
    pixels[rows, 2 * camera : 2 * camera + 2] = np.nan
    return replace(dataset, pixels=pixels)
