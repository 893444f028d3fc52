"""One Nico as it was really built, with cameras on links of its head; only the simulation knows."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph

from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.arm.dh_table import DhTable
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.self_model import SelfModel
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.plant.model_in_plant import ModelInPlant
from nico_selfmodel.systems.nico_cameras import MOUNTS
from nico_selfmodel.systems.simulated.cameras import built_lenses
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.instance import RobotInstance, tracker_pose
from nico_selfmodel.systems.simulated.mechanics import Mechanics

_HEAD_SIGMA = np.radians(1.0)
"""How far the joints of neck and cameras stand from where they should [rad]."""
_HEAD = ("neck", "eye")


@dataclass(frozen=True, eq=False)
class NicoInstance:
    """The truth about a body."""

    arm: ArmDescription
    """The robot as described."""
    mechanics: Mechanics
    """The arm, its servos and stops."""
    rig: StereoRig
    """The cameras; each `X_WC` is the camera's pose in the frame it is mounted on."""
    held: Mapping[str, float]
    """Joints that do not belong to the arm and are not at zero [rad]."""
    X_TB: NDArray
    """Pose of the arm's base in the motion tracker's frame. Shape (4, 4)."""

    @classmethod
    def build(
        cls, arm: ArmDescription, imperfections: Imperfections, seed: int, cameras: StereoRig
    ) -> "NicoInstance":
        """Build one.

        Args:
            seed: Which one.
            cameras: As designed; where they are mounted is the description's business.

        Raises:
            ValueError: If a joint of the arm has no limits.
        """
        rng = np.random.default_rng((seed, 20))
        mechanics = Mechanics.build(arm, imperfections, seed, rng).weighed(arm, rng)
        held = {
            joint: value + (_HEAD_SIGMA * rng.normal() if _of_the_head(joint) else 0.0)
            for joint, value in arm.held.items()
        }
        rig = built_lenses(cameras, seed)
        return cls(arm, mechanics, rig, MappingProxyType(held), tracker_pose(rng))

    @property
    def model(self) -> SelfModel:
        """The truth in the form that a plant is built from."""
        table = DhTable.from_chain(self.mechanics.chain)
        return SelfModel("truth", table, self.mechanics.servos)

    def in_scene(self, scene_graph: SceneGraph) -> ModelInPlant:
        """Return the robot in a plant of its own whose geometry goes into a scene graph."""
        return SelfModelPlant.from_urdf(self.arm, self.model, scene_graph=scene_graph)

    @property
    def ground_truth(self) -> GroundTruth:
        """What instruments beside it would say: for judging and for tests, never for learning."""
        X_BL, X_BR = self._camera_poses()
        rig = StereoRig(self.rig.left.at(np.eye(4)), self.rig.right.at(inverse(X_BL) @ X_BR))
        return GroundTruth(RobotInstance(self.mechanics, rig, X_BL, self.X_TB), held=self.held)

    def _camera_poses(self) -> list[NDArray]:
        """Return the true poses of both cameras in the arm's base. Shape (4, 4) each."""
        built = SelfModelPlant.from_urdf(self.arm, self.model)
        context = built.plant.CreateDefaultContext()
        positions = built.plant.GetPositions(context)
        for joint, value in self.held.items():
            positions[built.plant.GetJointByName(joint, built.instance).position_start()] = value
        built.plant.SetPositions(context, positions)
        mounts = [built.plant.GetBodyByName(link, built.instance) for link in MOUNTS]
        return [
            built.plant.EvalBodyPoseInWorld(context, mount).GetAsMatrix4() @ camera.X_WC
            for mount, camera in zip(mounts, self.rig.cameras, strict=True)
        ]


def _of_the_head(joint: str) -> bool:
    return any(part in joint for part in _HEAD)
