"""`nico-selfmodel servo simulate`: a bus to connect to, with or without a body behind it."""

import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console

if TYPE_CHECKING:
    from nico_selfmodel.systems import NicoBehindBus


def simulate(
    modules: Annotated[int, typer.Option("--modules", min=1, max=32, help="How many.")] = 6,
    config: Annotated[
        Path | None, typer.Option("--config", help="As many as this servo configuration has.")
    ] = None,
    hand: Annotated[bool, typer.Option("--hand", help="Simulate a hand too.")] = False,
    body: Annotated[
        Path | None,
        typer.Option(
            "--body",
            metavar="FILE",
            help="Let the boards turn a simulated Nico; its servo configuration goes to FILE.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="With --body: which individual.")] = 0,
    session: Annotated[
        int, typer.Option("--session", min=0, help="With --body: which day, for what is random.")
    ] = 0,
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.0, help="End after this time.")
    ] = None,
) -> None:
    """Simulate a bus and print the port to connect to; runs until Ctrl-C."""
    from nico_selfmodel.servos import ServoConfig, SimulatedBus, SimulatedHand

    if body is not None and config is not None:
        raise ValueError("--body writes the configuration of its own: leave --config out")
    with ExitStack() as stack:
        plant = None if body is None else _body(stack, body, seed, session)
        count = modules if config is None else len(ServoConfig.load(config).joints)
        count = count if plant is None else len(plant.station.joints)
        bus = stack.enter_context(SimulatedBus(count, plant=plant))
        console.out.print(f"servos {bus.name}", markup=False)
        if hand:
            simulated = stack.enter_context(SimulatedHand())
            console.out.print(f"hand {simulated.name}", markup=False)
        sys.stdout.flush()
        _wait(seconds)


def _body(stack: ExitStack, file: Path, seed: int, session: int) -> "NicoBehindBus":
    """Build a robot, write its configuration, and start its motion capture."""
    from nico_selfmodel.files import refuse_existing
    from nico_selfmodel.systems import MotionCaptureServer, NicoBehindBus, NicoStation

    refuse_existing(file, force=False)
    station = stack.enter_context(NicoStation("thesis", seed, session))
    server = stack.enter_context(MotionCaptureServer(station.arm.markers))
    plant = NicoBehindBus(station, server)
    plant.configuration.save(file)
    host, port = server.address
    console.out.print(f"config {file}\nmotion-capture {host}:{port}", markup=False)
    return plant


def _wait(seconds: float | None) -> None:
    until = None if seconds is None else time.monotonic() + seconds
    try:
        while until is None or time.monotonic() < until:
            left = 3600.0 if until is None else until - time.monotonic()
            time.sleep(max(0.0, left))
    except KeyboardInterrupt:
        pass
