"""Who stands beside a simulated Nico with calipers and motion capture, to judge what it learned."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset import JointInfo
from nico_selfmodel.geometry.plane import Plane
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model import Mirror, StereoRig
from nico_selfmodel.model.link_lengths import link_lengths
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.systems import (
    NICO_CAMERAS,
    CameraMeasurement,
    Imperfections,
    Measurement,
    NicoStation,
    StationBody,
)
from nico_selfmodel.systems.individual import Individual
from nico_selfmodel.systems.reach import MOUNTS
from nico_selfmodel.systems.simulated_body import expected_angles


class Outsider:
    """What outside instruments say of one individual. Nobody learns from it."""

    def __init__(self, arm: ArmDescription, world: Imperfections, seed: int) -> None:
        """Stand beside an individual.

        Args:
            arm: The robot and its arm, head turned to where it looks.
            world: What is wrong with the body.
            seed: Which individual.
        """
        body = Individual.build(arm, world, seed, NICO_CAMERAS)
        self._mechanics, self._world = body.mechanics, world
        built = SelfModelPlant.from_urdf(arm, body.model)
        context = built.plant.CreateDefaultContext()
        positions = built.plant.GetPositions(context)
        for joint, value in body.held.items():
            start = built.plant.GetJointByName(joint, built.instance).position_start()
            positions[start] = value
        built.plant.SetPositions(context, positions)
        X_BC = []
        for link, eye in zip(MOUNTS, body.rig.eyes, strict=True):
            mount = built.plant.GetBodyByName(link, built.instance)
            X_BK = built.plant.EvalBodyPoseInWorld(context, mount).GetAsMatrix4()
            X_BC.append(X_BK @ eye.X_WC)
        self._X_BL = X_BC[0]
        self._eyes = StereoRig(body.rig.left.at(X_BC[0]), body.rig.right.at(X_BC[1]))
        self._X_LT = inverse(body.X_TB @ self._X_BL)

    def calipers(self, marker: str) -> tuple[float, float]:
        """Measure the two links: shoulder to elbow, and elbow to a point on the hand [m]."""
        chain = self._mechanics.chain
        return link_lengths(chain, chain.marker_index(marker))

    def expected(self, encoders: ArrayLike, marker: str) -> tuple[NDArray, NDArray]:
        """Say what a body that knew itself exactly would expect: all but what is left to chance.

        Args:
            encoders: Readings [counts]. Shape (N, n).
            marker: The tracked point.

        Returns:
            Pixels in both eyes, shape (N, 4), and places in the left eye's frame [m], shape (N, 3).
        """
        body = self._mechanics
        q = expected_angles(body.chain, body.servos, encoders, self._world, body.largest_torque)
        p_BH = body.chain.forward(q, np.full(len(q), body.chain.marker_index(marker)))
        return self._eyes.project(p_BH), apply(inverse(self._X_BL), p_BH)

    def locate(self, p_TH: NDArray) -> NDArray:
        """Return points of motion capture in the left eye's frame [m]. Shape (m, 3)."""
        return apply(self._X_LT, p_TH)

    def mirror(self, X_BM: NDArray) -> Mirror:
        """Say where a glass stands before the left eye.

        Args:
            X_BM: Pose of the glass in the frame of the arm's base, z into it. Shape (4, 4).
        """
        X_LM = inverse(self._X_BL) @ X_BM
        normal = -X_LM[:3, 2]
        return Mirror.from_plane(Plane(normal, float(-normal @ X_LM[:3, 3])))


class ObservedBody:
    """A body whose hand an outsider measures at every pose it visits."""

    def __init__(self, body: StationBody, station: NicoStation, outsider: Outsider) -> None:
        """Watch a body.

        Args:
            body: Watched by its own eyes.
            station: The station that it drives.
            outsider: Who else watches.
        """
        self._body, self._station, self._outsider = body, station, outsider

    @property
    def joints(self) -> tuple[JointInfo, ...]:
        """Names, units and stops of the joints."""
        return self._body.joints

    @property
    def markers(self) -> tuple[str, ...]:
        """Names of the tracked points."""
        return self._body.markers

    def move_and_measure(self, command: ArrayLike) -> Measurement:
        """Move, look, and be measured in the left eye's frame; a point that is lost is None."""
        sighting = self._body.move_and_measure(command)
        assert isinstance(sighting, CameraMeasurement)
        port = self._station.GetOutputPort("measured_positions")
        p_TH = np.array(port.Eval(self._body.context), dtype=float).reshape(-1, 3)
        p_LH = self._outsider.locate(p_TH)
        # Measured or not, a pose counts where the eyes see the hand.
        seen = [np.isfinite(sighting.pixels[marker]).all() for marker in self.markers]
        points = {
            marker: p if here and np.isfinite(p).all() else None
            for marker, p, here in zip(self.markers, p_LH, seen, strict=True)
        }
        return replace(sighting, points=MappingProxyType(points))
