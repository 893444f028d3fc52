"""Nico at work, live: sliders move its joints, its self-model predicts what its eyes see."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.experiments.eyes_lesson import NicoBeforeItsEyes
from nico_selfmodel.model import SelfModel
from nico_selfmodel.model.stereo_rig import EYES
from nico_selfmodel.systems import NicoStation, StationBody, World
from nico_selfmodel.viz.station_view import StationView

STOP = "stop"
"""Label of the button that ends the show."""


class Watching:
    """A station and its view."""

    def __init__(
        self, model: SelfModel, world: World, seed: int, *, recording: bool = False
    ) -> None:
        """Wake the robot up and draw it.

        Args:
            model: What it has learned: arm and eyes.
            world: What is wrong with it.
            seed: Which individual; the one that learned the model.
            recording: Keep an animation.

        Raises:
            ModelError: If the model lacks arm or eyes, or tracks something else.
        """
        self.marker = model.markers[0]
        self._nico = NicoBeforeItsEyes(world, seed, (self.marker,))
        self._nico.arm.check_joints(model.joints)
        self.station: NicoStation = self._nico.station(99, model.rig)
        self.body = StationBody(self.station, self.station.joints, (self.marker,))
        self.model = model
        self.view = StationView(self._nico.arm, model, recording=recording)

    def show(self) -> NDArray:
        """Show the station as it is now.

        Returns:
            Distance of the predicted from the tracked pixels in each eye, nan where not seen [px].
        """
        context = self.body.context
        readings = self._read("encoders")
        pixels = self._read("hand_pixels")
        images = [self.station.picture(context, eye) for eye in EYES]
        self.view.show(readings, images, pixels)
        expected = self.model.rig.project(self.model.predict(readings).p_WH)[0]
        return np.linalg.norm((pixels - expected).reshape(2, 2), axis=1)

    def visit_random_poses(
        self, count: int, progress: Callable[[int, int], None] | None = None
    ) -> list[NDArray]:
        """Visit poses in view and show each.

        Returns:
            What `show` returned at each pose.
        """
        plan = self._nico.plan(self.station, 0, count, np.random.default_rng(7))
        errors = []
        for done, (_, command) in enumerate(plan[:count], start=1):
            self.body.visit(command)
            errors.append(self.show())
            if progress:
                progress(done, count)
        return errors

    def run(self, tell: Callable[[NDArray], None], seconds: float = np.inf) -> None:
        """Follow the sliders in real time until the stop button is pressed.

        Args:
            tell: Called with what `show` returned after every frame.
            seconds: How long at most [s].
        """
        meshcat = self.view.meshcat
        servos = self.model.servos
        start = self._read("encoders")
        for i, joint in enumerate(self.station.joints):
            ends = np.array([joint.lower, joint.upper], dtype=float)
            low, high = self._degrees(servos.to_joint(np.tile(ends, (len(start), 1)).T)[:, i])
            here = float(np.degrees(servos.to_joint(start)[i]))
            meshcat.AddSlider(
                f"{joint.name} [deg]", low, high, 0.5, float(np.clip(here, low, high))
            )
        meshcat.AddButton(STOP)
        simulator = self.body.simulator
        began, first = time.monotonic(), simulator.get_context().get_time()
        while meshcat.GetButtonClicks(STOP) == 0 and time.monotonic() - began < seconds:
            wanted = [
                meshcat.GetSliderValue(f"{joint.name} [deg]") for joint in self.station.joints
            ]
            command = servos.to_encoder(np.radians(wanted))
            self.station.GetInputPort("command").FixValue(self.body.context, command)
            simulator.AdvanceTo(first + time.monotonic() - began)
            tell(self.show())
        meshcat.DeleteAddedControls()

    def _read(self, port: str) -> NDArray:
        return np.array(self.station.GetOutputPort(port).Eval(self.body.context))

    @staticmethod
    def _degrees(ends: NDArray) -> tuple[float, float]:
        low, high = np.sort(np.degrees(ends))
        return float(low), float(high)
