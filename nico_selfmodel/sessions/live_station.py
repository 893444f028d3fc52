"""A station at work, live: it visits poses, or follows sliders until a button is pressed."""

import time
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.systems.closing import Closable
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.viz.live.moving_scene import MovingScene

STOP = "stop"
"""Label of the button that ends the show."""

View = TypeVar("View", bound=MovingScene)
Errors = TypeVar("Errors")


class LiveStation(Closable, Generic[View, Errors]):
    """A station and its view; closing gives the station back."""

    station: NicoStation
    """What moves."""
    body: StationBody
    """What drives it."""
    view: View
    """What is shown, whose page has the sliders."""

    def show(self) -> Errors:
        """Show the station as it is now.

        Returns:
            How far prediction and observation are apart.
        """
        raise NotImplementedError

    def visit_random_poses(
        self, count: int, progress: Callable[[int, int], None] | None = None
    ) -> list[Errors]:
        """Visit poses in view and show each.

        Returns:
            What `show` returned at each pose.
        """
        errors = []
        for done, command in enumerate(self._in_view(count), start=1):
            self.body.move_and_measure(command)
            errors.append(self.show())
            if progress:
                progress(done, count)
        return errors

    def run(self, tell: Callable[[Errors], None], seconds: float = np.inf) -> None:
        """Follow the sliders in real time until the stop button is pressed.

        Args:
            tell: Called with what `show` returned after every frame.
            seconds: How long at most [s].
        """
        meshcat, joints = self.view.meshcat, self.station.joints
        here = np.degrees(self._to_joint(self._read("encoders")))
        labels = [f"{joint.name} [deg]" for joint in joints]
        ends = np.array([[joint.lower, joint.upper] for joint in joints], dtype=float).T
        low, high = np.sort(np.degrees(self._to_joint(ends)), axis=0)
        for i, label in enumerate(labels):
            start = float(np.clip(here[i], low[i], high[i]))
            meshcat.AddSlider(label, float(low[i]), float(high[i]), 0.5, start)
        meshcat.AddButton(STOP)
        simulator = self.body.simulator
        began, first = time.monotonic(), simulator.get_context().get_time()
        wanted = self.station.GetInputPort("encoders_commanded")
        while meshcat.GetButtonClicks(STOP) == 0 and time.monotonic() - began < seconds:
            angles = np.radians([meshcat.GetSliderValue(label) for label in labels])
            wanted.FixValue(self.body.context, self._to_encoder(angles))
            simulator.AdvanceTo(first + time.monotonic() - began)
            tell(self.show())
        meshcat.DeleteAddedControls()

    def _in_view(self, count: int) -> Iterable[NDArray]:
        """Return commands of poses in which something is seen [encoder units]. Shape (n,) each."""
        raise NotImplementedError

    def _to_joint(self, readings: NDArray) -> NDArray:
        """Return angles [rad] of readings [encoder units]. Shape (..., n)."""
        raise NotImplementedError

    def _to_encoder(self, angles: NDArray) -> NDArray:
        """Return readings [encoder units] of angles [rad]. Shape (..., n)."""
        raise NotImplementedError

    def _read(self, port: str) -> NDArray:
        return np.array(self.station.GetOutputPort(port).Eval(self.body.context))

    def _give_back(self) -> None:
        self.station.close()
