"""A station that follows sliders on a Meshcat page, until a button is pressed."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody
from nico_selfmodel.viz.live.moving_scene import MovingScene

STOP = "stop"
"""Label of the button that ends the show."""


def follow_sliders(
    view: MovingScene,
    station: NicoStation,
    body: StationBody,
    to_joint: Callable[[NDArray], NDArray],
    to_encoder: Callable[[NDArray], NDArray],
    frame: Callable[[], None],
    seconds: float,
) -> None:
    """Move joints as sliders say, in real time.

    Args:
        view: What is shown, whose page has the sliders.
        station: What moves.
        body: What drives it.
        to_joint: Readings [encoder units] to angles [rad]. Shape (..., n).
        to_encoder: Angles [rad] to readings [encoder units]. Shape (n,).
        frame: Called whenever it has moved.
        seconds: How long at most [s].
    """
    meshcat = view.meshcat
    start = np.array(station.GetOutputPort("encoders").Eval(body.context))
    here = np.degrees(to_joint(start))
    labels = [f"{joint.name} [deg]" for joint in station.joints]
    for i, joint in enumerate(station.joints):
        ends = np.array([joint.lower, joint.upper], dtype=float)
        low, high = np.sort(np.degrees(to_joint(np.tile(ends, (len(start), 1)).T)[:, i])).tolist()
        meshcat.AddSlider(labels[i], low, high, 0.5, float(np.clip(here[i], low, high)))
    meshcat.AddButton(STOP)
    simulator = body.simulator
    began, first = time.monotonic(), simulator.get_context().get_time()
    while meshcat.GetButtonClicks(STOP) == 0 and time.monotonic() - began < seconds:
        wanted = np.radians([meshcat.GetSliderValue(label) for label in labels])
        station.GetInputPort("encoders_commanded").FixValue(body.context, to_encoder(wanted))
        simulator.AdvanceTo(first + time.monotonic() - began)
        frame()
    meshcat.DeleteAddedControls()
