"""A simulated robot that keeps to itself how it was built."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.geometry.rotation import rotation_from_vector
from nico_selfmodel.geometry.transform import transform
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.systems.measurements import Measurement
from nico_selfmodel.systems.nico_cameras import NICO_CAMERAS
from nico_selfmodel.systems.simulated.cameras import built_rig
from nico_selfmodel.systems.simulated.faults import Change, FaultInjector
from nico_selfmodel.systems.simulated.ground_truth import GroundTruth
from nico_selfmodel.systems.simulated.imperfections import Imperfections
from nico_selfmodel.systems.simulated.instance import RobotInstance, tracker_pose
from nico_selfmodel.systems.simulated.mechanics import Mechanics
from nico_selfmodel.systems.simulated.sensors import MotionCaptureSensor, Sensor, StereoPixels

if TYPE_CHECKING:
    # The plant is slow to load.
    from nico_selfmodel.plant import ArmDescription


_NECK_TURN, _NECK_SHIFT = np.radians(2.0), 3e-3
"""How far the head stands from where the description has it [rad, m]."""


@dataclass(eq=False)
class _Hidden:
    """What changes and nobody sees."""

    instance: RobotInstance
    p_BH: NDArray
    q_dragged: NDArray | None = None


class SimulatedRobot:
    """Encoders that can be commanded and a sensor that sees markers; nothing else shows.

    A learner has only what a real robot would give it. What is true stands behind one door,
    `ground_truth`; what can happen to the robot behind another, `faults`.
    """

    def __init__(
        self, instance: RobotInstance, sensor: Sensor, seed: int | tuple[int, ...] = 0
    ) -> None:
        """Take a robot as it was built.

        Args:
            sensor: What watches its markers; may be replaced later.
            seed: Of what happens by chance: play, wobble, noise, lost markers.
        """
        self.sensor = sensor
        self.__hidden = _Hidden(instance, np.zeros((0, 3)))
        self._rng = np.random.default_rng(seed)

    @classmethod
    def under_motion_capture(
        cls, arm: "ArmDescription", imperfections: Imperfections, seed: int, session: int = 0
    ) -> "SimulatedRobot":
        """Build one that motion capture watches.

        Args:
            seed: Which one: its geometry, gears and encoder zeros.
            session: Of the random things that happen to it: play, noise, lost markers.

        Raises:
            ValueError: If a joint limit is missing or crossed, or a joint has no room to move.
        """
        rng = np.random.default_rng(seed)
        mechanics = Mechanics.build(arm, imperfections, seed, rng)
        X_TB = tracker_pose(rng)
        robot = RobotInstance(mechanics.weighed(arm, rng), X_TB=X_TB)
        sensor = MotionCaptureSensor(imperfections.marker_sigma, imperfections.dropout_share)
        return cls(robot, sensor, (seed, session, 1))

    @classmethod
    def with_cameras(
        cls,
        arm: "ArmDescription",
        X_BL: ArrayLike,
        imperfections: Imperfections,
        seed: int,
        session: int = 0,
        *,
        pixel_sigma: float,
        cameras: StereoRig = NICO_CAMERAS,
    ) -> "SimulatedRobot":
        """Build one that sees its own hand.

        Args:
            X_BL: Pose of the left camera in the base as described. Shape (4, 4).
            imperfections: What is wrong with the body; its marker noise and drop-outs do not
                count here.
            seed: Which one: geometry, gears, encoder zeros, lenses.
            session: Of the random things that happen to it: play and pixel noise.
            pixel_sigma: Noise of a tracked pixel coordinate [px].
            cameras: The cameras as designed, the left one at the world.

        Raises:
            ValueError: If a joint limit is missing or crossed, or a joint has no room to move.
        """
        rng = np.random.default_rng((seed, 9))
        mechanics = Mechanics.build(arm, imperfections, seed, rng)
        if imperfections.sag:
            mechanics = mechanics.weighed(arm, np.random.default_rng((seed, 15)))
        neck = rotation_from_vector(rng.normal(0.0, _NECK_TURN, 3))
        X_BE = np.asarray(X_BL, dtype=float) @ transform(neck, rng.normal(0.0, _NECK_SHIFT, 3))
        # The rig stands only nearly at its own world: what counts is the true left camera.
        rig = built_rig(cameras, np.random.default_rng((seed, 7)))
        robot = RobotInstance(mechanics, rig.moved(rig.left.X_WC), X_BE @ rig.left.X_WC)
        return cls(robot, StereoPixels(pixel_sigma), (seed, session, 10))

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints, as a data set states them."""
        return self.__hidden.instance.mechanics.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the markers that the sensor can see."""
        return self.__hidden.instance.mechanics.markers

    @property
    def ground_truth(self) -> GroundTruth:
        """What only the simulation knows: for judging and for tests, never for learning."""
        return GroundTruth(self.__hidden.instance, self.__hidden.p_BH)

    @property
    def faults(self) -> FaultInjector:
        """What can happen to it."""
        return FaultInjector(self.__change)

    def move_and_measure(self, command: ArrayLike) -> Measurement:
        """Move to encoder readings, settle, and look.

        Args:
            command: Where to go [counts]; kept between the stops. Shape (n,).

        Returns:
            What was sensed there; `CameraMeasurement` from cameras.

        Raises:
            ValueError: If the command has another length or is not finite.
        """
        robot = self.__hidden.instance
        encoders = robot.mechanics.reached(command)
        dragged = robot.mechanics.dragged(encoders, self.__hidden.q_dragged)
        self.__hidden.q_dragged = dragged
        q = robot.mechanics.angles(dragged, self._rng)
        p_BH = robot.mechanics.points(q)
        self.__hidden.p_BH = p_BH
        return self.sensor.measure(robot.posed(q), encoders, p_BH, self._rng)

    def relive(self, command: ArrayLike) -> None:
        """Go to a pose again unseen: play and noise are drawn one after the other."""
        self.move_and_measure(command)

    def __change(self, change: Change) -> None:
        self.__hidden.instance = change(self.__hidden.instance)
