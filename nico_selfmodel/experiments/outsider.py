"""Who stands beside a simulated Nico with calipers and motion capture, to judge what it learned."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nico_selfmodel.dataset import JointInfo
from nico_selfmodel.geometry.transform import apply, inverse
from nico_selfmodel.model.link_lengths import link_lengths
from nico_selfmodel.plant import ArmDescription, SelfModelPlant
from nico_selfmodel.systems import (
    NICO_EYES,
    EyeSighting,
    NicoStation,
    Sighting,
    StationBody,
    World,
)
from nico_selfmodel.systems.individual import Individual
from nico_selfmodel.systems.reach import MOUNTS


class Outsider:
    """What outside instruments say of one individual. Nobody learns from it."""

    def __init__(self, arm: ArmDescription, world: World, seed: int) -> None:
        """Stand beside an individual.

        Args:
            arm: The robot and its arm, head turned to where it looks.
            world: What is wrong with the body.
            seed: Which individual.
        """
        body = Individual.build(arm, world, seed, NICO_EYES)
        self._chain = body.mechanics.chain
        built = SelfModelPlant.from_urdf(arm, body.model)
        context = built.plant.CreateDefaultContext()
        positions = built.plant.GetPositions(context)
        for joint, value in body.held.items():
            start = built.plant.GetJointByName(joint, built.instance).position_start()
            positions[start] = value
        built.plant.SetPositions(context, positions)
        mount = built.plant.GetBodyByName(MOUNTS[0], built.instance)
        X_BM = built.plant.EvalBodyPoseInWorld(context, mount).GetAsMatrix4()
        self._X_LT = inverse(body.X_TB @ X_BM @ body.rig.left.X_WC)

    def calipers(self, marker: str) -> tuple[float, float]:
        """Measure the two links: shoulder to elbow, and elbow to a point on the hand [m]."""
        return link_lengths(self._chain, self._chain.marker_index(marker))

    def locate(self, p_TH: NDArray) -> NDArray:
        """Return points of motion capture in the left eye's frame [m]. Shape (m, 3)."""
        return apply(self._X_LT, p_TH)


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

    def visit(self, command: ArrayLike) -> Sighting:
        """Move, look, and be measured in the left eye's frame; a point that is lost is None."""
        sighting = self._body.visit(command)
        assert isinstance(sighting, EyeSighting)
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
