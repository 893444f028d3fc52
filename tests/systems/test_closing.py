"""Stations give their renderers back when they are closed, and say so to whoever asks later."""

import gc
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from nico_selfmodel.errors import RobotError
from nico_selfmodel.sessions.rendered_nico import RenderedNico
from nico_selfmodel.systems.closing import Closable
from nico_selfmodel.systems.rendering.mirror_scene import MirrorPlate
from nico_selfmodel.systems.rendering.stereo_cameras import ImageQuality
from nico_selfmodel.systems.stations.nico_station import NicoStation
from nico_selfmodel.systems.stations.station_body import StationBody

ROUGH = ImageQuality(1)
IN_ALL = 50.0
"""What fifty stations may leave behind [MB]."""
EACH_UNCLOSED = 30.0
"""What a station that is not closed leaves behind at least [MB]."""


def memory():
    """Return what this process holds [MB]."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


class Thing(Closable):
    """Counts how often it gave something back."""

    given_back = 0

    def _give_back(self):
        self.given_back += 1


def test_what_is_closed_twice_gives_back_once_and_cannot_be_entered_again():
    with Thing() as thing:
        assert not thing.is_closed
    thing.close()
    assert thing.is_closed
    assert thing.given_back == 1
    with pytest.raises(RobotError, match="this Thing was closed: make a new one"), thing:
        pass


def test_what_fails_in_its_block_gives_back_too():
    thing = Thing()
    with pytest.raises(KeyError), thing:
        raise KeyError
    assert thing.given_back == 1


def outputs(system):
    return [system.get_output_port(k) for k in range(system.num_output_ports())]


@pytest.mark.slow
@pytest.mark.parametrize("plate", [None, MirrorPlate()])
def test_a_station_that_was_closed_refuses_every_port(plate):
    with NicoStation("thesis", 3, quality=ROUGH, mirror=plate) as station:
        context = station.CreateDefaultContext()
        station.GetInputPort("encoders_commanded").FixValue(context, np.zeros(len(station.joints)))
        assert station.picture(context, "left").any()
        fresh = station.CreateDefaultContext()
    for port in outputs(station):
        with pytest.raises(RobotError, match=r"this \w+ was closed: make a new one"):
            port.Eval(fresh)
    for ask in (
        lambda: station.picture(context, "left"),
        lambda: station.hold_board(context, None),
    ):
        with pytest.raises(RobotError, match="this NicoStation was closed"):
            ask()


@pytest.mark.slow
def test_a_diagram_whose_station_was_closed_does_not_go_on():
    builder = DiagramBuilder()
    station = builder.AddSystem(NicoStation("thesis", 3, quality=ROUGH))
    simulator = Simulator(builder.Build())
    context = station.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    station.GetInputPort("encoders_commanded").FixValue(context, np.zeros(len(station.joints)))
    simulator.AdvanceTo(0.05)
    station.close()
    with pytest.raises(RobotError, match="was closed"):
        simulator.AdvanceTo(0.5)


@pytest.mark.slow
def test_whoever_records_closes_the_stations(monkeypatch):
    made = []
    nico = RenderedNico("clean", 3, ("fiducial",), ROUGH)
    station = nico.station
    monkeypatch.setattr(nico, "station", lambda *a: made.append(station(*a)) or made[-1])
    nico.record("one", 0, 0, 1)
    nico.board_views(1)
    assert [station.is_closed for station in made] == [True, True]


def look(seed, *, close=True):
    """Use a station as programs do."""
    station = NicoStation("thesis", seed, quality=ROUGH)
    body = StationBody(station, station.joints, station.tracked)
    for camera in ("left", "right"):
        station.picture(body.context, camera)
    if close:
        station.close()


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux' own account")
def test_fifty_stations_that_are_closed_leave_little_behind():
    look(0)
    before = memory()
    for seed in range(1, 51):
        look(seed)
    assert memory() - before < IN_ALL


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads Linux' own account")
def test_a_station_that_is_not_closed_leaves_its_renderer_behind():
    """Where Drake gives it back by itself one day, closing is needed no more."""
    look(0)
    before = memory()
    for seed in range(1, 4):
        look(seed, close=False)
    assert memory() - before > 3.0 * EACH_UNCLOSED
