"""`nico-selfmodel servo simulate`: a bus to connect to, with or without a body behind it."""

import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer

if TYPE_CHECKING:
    from nico_selfmodel.servos.makes import Make
    from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus


def simulate(
    modules: Annotated[
        int, typer.Option("--modules", min=1, max=32, help="How many, without --config.")
    ] = 6,
    config: options.ConfigOrNone = None,
    make: options.Make = "pic-servo",
    hand: Annotated[bool, typer.Option("--hand", help="Simulate a hand too.")] = False,
    body: Annotated[
        bool, typer.Option("--body", help="Let the motors turn a simulated Nico; needs --out.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option("--out", help="Servo configuration of that body, to make.")
    ] = None,
    seed: options.RobotSeed = 0,
    session: options.Session = 0,
    seconds: options.Seconds = None,
) -> None:
    """Simulate a bus and print its port; runs until Ctrl-C."""
    from nico_selfmodel.servos import SimulatedBus
    from nico_selfmodel.servos.arm.servo_config_file import load_servo_config
    from nico_selfmodel.servos.drivers import simulated_motors
    from nico_selfmodel.servos.makes import make_named
    from nico_selfmodel.servos.simulated.hand import SimulatedHand

    if body != (out is not None):
        raise ValueError("--body and --out belong together")
    if body and config is not None:
        raise ValueError("--body writes the configuration of its own: leave --config out")
    with ExitStack() as stack:
        kind, motors = make_named(make), modules
        plant = None if out is None else _body(stack, out, seed, session, kind)
        arm = None if config is None else load_servo_config(config)
        arm = arm if plant is None else plant.configuration
        if arm is not None:
            kind, motors = arm.make, simulated_motors(arm)
        bus = stack.enter_context(SimulatedBus(motors, make=kind.name, plant=plant))
        printer.line(f"servos {bus.name}")
        if hand:
            simulated = stack.enter_context(SimulatedHand())
            printer.line(f"hand {simulated.name}")
        sys.stdout.flush()
        _wait(seconds)


def _body(stack: ExitStack, file: Path, seed: int, session: int, make: "Make") -> "NicoBehindBus":
    """Build a robot, write its configuration, and start its motion capture."""
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.servos.arm.servo_config_file import save_servo_config
    from nico_selfmodel.systems.hardware.motion_capture_stream import MotionCaptureServer
    from nico_selfmodel.systems.simulated.imperfections import imperfections_named
    from nico_selfmodel.systems.stations.nico_behind_bus import NicoBehindBus
    from nico_selfmodel.systems.stations.nico_station import NicoStation

    refuse_existing(file, force=False)
    world = imperfections_named("thesis")
    if make.counts_per_turn is not None:
        world = replace(world, counts_per_turn=int(make.counts_per_turn))
    station = stack.enter_context(NicoStation(world, seed, session))
    server = stack.enter_context(MotionCaptureServer(station.arm.markers))
    plant = NicoBehindBus(station, server, make)
    save_servo_config(plant.configuration, file)
    host, port = server.address
    printer.line(f"config {file}\nmotion-capture {host}:{port}")
    return plant


def _wait(seconds: float | None) -> None:
    until = None if seconds is None else time.monotonic() + seconds
    try:
        while until is None or time.monotonic() < until:
            left = 3600.0 if until is None else until - time.monotonic()
            time.sleep(max(0.0, left))
    except KeyboardInterrupt:
        pass
