"""One whole Nico as it was really built, its head turning; only the simulation knows."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import SceneGraph

from nico_selfmodel.geometry.transform import inverse
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.plant.model_in_plant import ModelInPlant
from nico_selfmodel.systems.simulated.body_mechanics import BodyMechanics
from nico_selfmodel.systems.simulated.cameras import built_lenses
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.instance import RobotInstance, tracker_pose


@dataclass(frozen=True, eq=False)
class WholeNico:
    """The truth about a body whose head is commanded too. B is the root link's frame."""

    body: BodyDescription
    """The robot as described."""
    mechanics: BodyMechanics
    """All its joints, its points and cameras, servos and stops."""
    X_TB: NDArray
    """Pose of the root link in the motion tracker's frame. Shape (4, 4)."""

    @classmethod
    def build(
        cls, body: BodyDescription, imperfections: Imperfections, seed: int, cameras: StereoRig
    ) -> "WholeNico":
        """Build one; its lenses are those of the `NicoInstance` of this seed.

        Args:
            seed: Which one.
            cameras: As designed; where they are mounted is the description's business.

        Raises:
            ValueError: If a joint has no limits.
        """
        rig = built_lenses(cameras, seed)
        mechanics = BodyMechanics.build(body, imperfections, seed, rig)
        return cls(body, mechanics, tracker_pose(np.random.default_rng((seed, 23))))

    @property
    def rig(self) -> StereoRig:
        """The cameras; each `X_WC` is the camera's pose in the frame it is mounted on."""
        tree, nominal = self.mechanics.tree, self.body.tree
        return StereoRig(
            *(
                tree.lenses[true.name].at(inverse(mount.X_LA) @ true.X_LA)
                for true, mount in zip(tree.sensors, nominal.sensors, strict=True)
            )
        )

    @property
    def held(self) -> Mapping[str, float]:
        """Where joints stand that nobody commands [rad]."""
        tree, rest = self.mechanics.tree, self.mechanics.rest
        return {name: float(rest[tree.joints.index(name)]) for name in self.body.held}

    def in_scene(self, scene_graph: SceneGraph) -> ModelInPlant:
        """Return the robot in a plant of its own whose geometry goes into a scene graph."""
        return self.body.built(self.mechanics.tree, scene_graph)

    @property
    def ground_truth(self) -> GroundTruth:
        """What instruments beside it would say: for judging and for tests, never for learning."""
        return self.standing(self.mechanics.servos.to_joint(np.zeros(len(self.body.joints))))

    def standing(self, q: NDArray) -> GroundTruth:
        """Return the same with its cameras where joint angles [rad] of shape (k,) have them."""
        return GroundTruth(RobotInstance(self.mechanics, X_TB=self.X_TB).posed(q))
