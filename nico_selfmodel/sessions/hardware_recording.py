"""Recording a real robot, through its servo bus: the poses, and the way to them."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.dataset.csv_table import CsvTable
from nico_selfmodel.dataset.dataset import Dataset
from nico_selfmodel.dataset.joint_info import JointInfo
from nico_selfmodel.dataset.readings import readings_from_table
from nico_selfmodel.errors import DataError
from nico_selfmodel.model.cameras.stereo_rig import StereoRig
from nico_selfmodel.model.tree.body_model import BodyModel
from nico_selfmodel.planning.first_guess import first_guess
from nico_selfmodel.planning.plans import HOME, Plan, given_commands
from nico_selfmodel.planning.sweep_protocol import SweepProtocol
from nico_selfmodel.planning.visible_workspace import VisibleWorkspace
from nico_selfmodel.plant import ArmDescription
from nico_selfmodel.plant.body_description import BodyDescription
from nico_selfmodel.plant.collisions import CollisionShapes
from nico_selfmodel.plant.robots import ROBOTS
from nico_selfmodel.recording.session import Progress, record
from nico_selfmodel.sessions.camera_scenario import MARKERS
from nico_selfmodel.sessions.whole_recording import WholeRecording
from nico_selfmodel.systems.looking import looking_arm
from nico_selfmodel.systems.stations.nico_detectors import default_detectors
from nico_selfmodel.systems.stations.nico_hardware_station import NicoHardwareStation
from nico_selfmodel.systems.tracking.hand_tracker import Detectors


@dataclass(frozen=True, eq=False)
class Recording(ABC):
    """What is to be recorded of a real robot."""

    sensor: str
    """`motion-capture`, `stereo-fiducial` or `stereo-color`."""
    joints: tuple[JointInfo, ...]
    """Joints that move, with their limits."""
    plan: Plan
    """The poses [counts]."""
    enough: int | None = field(default=None, kw_only=True)
    """Free poses that are enough, where the plan holds some to spare."""

    @property
    @abstractmethod
    def robot(self) -> str:
        """Name of the robot."""

    @property
    @abstractmethod
    def moves(self) -> str:
        """What moves, in words."""

    @abstractmethod
    def detectors(self, rig: StereoRig | None) -> Detectors:
        """Return what finds markers in pictures, behind the lenses of calibrated cameras."""

    def run(
        self,
        station: NicoHardwareStation,
        name: str,
        *,
        source: str,
        folder: Path | None = None,
        keep_images: bool = False,
        progress: Progress | None = None,
    ) -> Dataset:
        """Visit the poses with a station that is open and enabled.

        Args:
            station: Of the joints of this recording.
            source: Where the data come from, for people.
            folder: Where to keep the samples from the first one on; resumed if it is there.

        Raises:
            RobotError: If the robot fails; what was recorded so far is in `partial`.
            DataError: If the folder holds something else, or nothing was seen at all.
        """
        by_camera = self.sensor in MARKERS
        body = station.body("cameras" if by_camera else "motion-capture", keep_images=keep_images)
        return record(
            body,
            self.plan,
            name,
            source=source,
            image_size=station.image_size if by_camera else None,
            until_seen=2,
            enough=self.enough,
            folder=folder,
            progress=progress,
        )


@dataclass(frozen=True, eq=False)
class RealRecording(Recording):
    """What is to be recorded of which arm.

    A robot that has learned nothing knows the stops of its joints, and about where they should be:
    the limits of its servo configuration count as those of its description.
    """

    arm: ArmDescription
    """The arm as described."""

    @classmethod
    def planned(
        cls,
        sensor: str,
        servos: Sequence[JointInfo],
        circle: int,
        free: int,
        rng: np.random.Generator,
        table: CsvTable | None = None,
        arm: ArmDescription | None = None,
    ) -> "RealRecording":
        """Plan poses in which the described arm touches neither its body nor itself.

        Args:
            sensor: `motion-capture`, `stereo-fiducial` or `stereo-color`.
            servos: The joints that the servos drive, with limits.
            circle: Poses on circles, home not counted.
            free: Random poses.
            table: Poses to visit instead of random ones, a column a joint [counts].
            arm: The arm, its limits those of the servos; of Nico's the one that they drive.

        Raises:
            DataError: If the servos do not drive all joints of the arm, or the table is not one.
            ValueError: If a given pose lies beyond a stop, or touches the body, or cameras are to
                watch another arm than Nico's.
        """
        by_camera = sensor in MARKERS
        if arm is not None and by_camera:
            raise ValueError("cameras watch Nico's arm: with --robot give --sensor motion-capture")
        if arm is None:
            arm = looking_arm(MARKERS[sensor]) if by_camera else _arm_of(servos)
        joints = _joints_of(arm, servos)
        planned = _by_cameras if by_camera else _by_motion_capture
        plan = planned(arm, joints, circle, free if table is None else 0, rng)
        if table is None:
            return cls(sensor, joints, plan, arm, enough=free if by_camera else None)
        given = given_commands(joints, readings_from_table(table, arm.joints))
        _refuse_touching(_touching(arm, joints, given))
        return cls(sensor, joints, plan + given, arm)

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return Path(self.arm.robot).stem

    @property
    def moves(self) -> str:
        """What moves, in words."""
        return "the arm"

    def detectors(self, rig: StereoRig | None) -> Detectors:
        """Return what finds markers in pictures, behind the lenses of calibrated cameras."""
        found = default_detectors(rig)
        return {m: found[m] for m in self.arm.markers if m in found} or found


@dataclass(frozen=True, eq=False)
class RealBodyRecording(Recording):
    """A real Nico that looks at cards in a room, and at its hands.

    The limits of its servo configuration count as those of its description.
    """

    whole: WholeRecording
    """What moves, and what hangs about it."""

    @classmethod
    def planned(
        cls,
        whole: WholeRecording,
        servos: Sequence[JointInfo],
        looks: int,
        hands: int,
        rng: np.random.Generator,
        given: NDArray | None = None,
        learned: BodyModel | None = None,
    ) -> "RealBodyRecording":
        """Plan poses in which the robot as described touches nothing and sees what is wanted.

        Args:
            whole: What moves, and what hangs about it.
            servos: The joints that the servos drive, with limits.
            looks: Poses in which only the room is wanted.
            given: Poses to visit instead [counts]. Shape (N, k).
            learned: What was learned of its head; as described if omitted.

        Raises:
            DataError: If the servos do not drive all joints.
            ModelError: If hardly any pose shows a hand.
            ValueError: If a given pose lies beyond a stop, or touches something.
        """
        joints = _joints_of(whole.body, servos)
        if given is None:
            known = whole.known(learned, joints)
            given = whole.commands(joints, whole.plan(looks, hands, rng, known))
        plan = given_commands(joints, given)
        _refuse_touching([whole.view.shapes.collides(q) for q in whole.angles(joints, given)])
        return cls("stereo-fiducial", joints, plan, whole)

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return "nico"

    @property
    def moves(self) -> str:
        """What moves, in words."""
        return "head and arms" if self.whole.arms else "the head"

    def detectors(self, rig: StereoRig | None) -> Detectors:
        """Return what finds hands and cards in pictures, behind the lenses of the cameras."""
        return self.whole.detectors(rig)


def _refuse_touching(touches: Sequence[bool]) -> None:
    """Refuse poses that were given and touch something."""
    touching = np.flatnonzero(touches)
    if touching.size:
        raise ValueError(
            f"{touching.size} of {len(touches)} poses touch the body by its description, the "
            f"first is pose {touching[0] + 1}: take them out"
        )


def _arm_of(servos: Sequence[JointInfo]) -> ArmDescription:
    """Return the first of Nico's arms whose joints are all driven."""
    names = {joint.name for joint in servos}
    arms = [ArmDescription.named("nico", name) for name in ROBOTS["nico"]]
    return next((arm for arm in arms if names >= set(arm.joints)), arms[0])


def _joints_of(
    arm: ArmDescription | BodyDescription, servos: Sequence[JointInfo]
) -> tuple[JointInfo, ...]:
    by_name = {joint.name: joint for joint in servos}
    missing = [name for name in arm.joints if name not in by_name]
    if missing:
        raise DataError(
            f"the servo configuration has no {', '.join(missing)}: this recording moves "
            f"{', '.join(arm.joints)}"
        )
    return tuple(by_name[name] for name in arm.joints)


def _by_cameras(
    arm: ArmDescription,
    joints: tuple[JointInfo, ...],
    circle: int,
    free: int,
    rng: np.random.Generator,
) -> Plan:
    return VisibleWorkspace.of(arm).plan(joints, circle, free, rng)


def _by_motion_capture(
    arm: ArmDescription,
    joints: tuple[JointInfo, ...],
    circle: int,
    free: int,
    rng: np.random.Generator,
) -> Plan:
    each = max(1, round(circle / len(joints))) + 1
    spare = int(np.ceil(1.5 * free)) + 10
    protocol = replace(SweepProtocol.for_arm(arm), random_poses=spare, circle_points=each)
    plan = protocol.plan(joints, rng, sweeps=circle > 0)
    touching = _touching(arm, joints, plan)
    clear = [pose for pose, touches in zip(plan, touching, strict=True) if not touches]
    if circle and not any(label == HOME for label, _ in clear):
        raise DataError("the arm's home touches the body by its description: plan other circles")
    random = [pose for pose in clear if pose[0] == ""][:free]
    return [pose for pose in clear if pose[0]] + random


def _touching(arm: ArmDescription, joints: tuple[JointInfo, ...], plan: Plan) -> list[bool]:
    """Return at which poses the arm touches its body or itself, by its description."""
    if not plan:
        return []
    servos, body = first_guess(arm, None, joints).servos, CollisionShapes(arm)
    q = servos.to_joint(np.array([command for _, command in plan]))
    return [bool(body.collides(angles)) for angles in q]
