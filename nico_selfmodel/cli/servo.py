"""`nico-selfmodel servo`: the real servos, or a simulated bus of them."""

import json
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import console, servo_motion, servo_simulation
from nico_selfmodel.cli.servo_options import Config, Json, Model, Port, TrustZero, Yes, ask, opened

if TYPE_CHECKING:
    from nico_selfmodel.servos import ArmController, ArmState, FoundModule

app = typer.Typer(help="Drive the real servos.", no_args_is_help=True)
# A negative angle is no option.
_NUMBERS_MAY_BE_NEGATIVE = {"ignore_unknown_options": True}
app.command("move", context_settings=_NUMBERS_MAY_BE_NEGATIVE)(servo_motion.move)
app.command("home")(servo_motion.home)
app.command("simulate")(servo_simulation.simulate)


@app.callback()
def _describe() -> None:
    """Drive the real servos."""


@app.command("scan")
def scan(
    port: Port,
    baud: Annotated[int, typer.Option("--baud", help="Rate of the line.")] = 19200,
    up_to: Annotated[
        int, typer.Option("--up-to", min=1, max=127, help="Highest address to look at.")
    ] = 32,
    as_json: Json = False,
) -> None:
    """Find the modules of a bus and give addresses to new ones. Moves and resets nothing."""
    from nico_selfmodel.errors import BusError
    from nico_selfmodel.servos import BAUD_CODES, Bus, scan

    if baud not in BAUD_CODES:
        raise ValueError(f"--baud must be one of {sorted(BAUD_CODES)}, got {baud}")
    with Bus.open(port, baud) as bus:
        found = scan(bus, range(1, up_to + 1))
        counts = bus.total().to_mapping()
    if not found:
        raise BusError(
            f"no module answers on {port} at {baud} baud: are the boards switched on? "
            "Another rate may be set: try --baud"
        )
    if as_json:
        modules = [_module(module) for module in found]
        console.print_json({"port": port, "baud": baud, "modules": modules, "link": counts})
        return
    rows = [[_word(value) for value in _module(module).values()] for module in found]
    headings = ("address", "device", "counts", "servo on", "homed", "new")
    console.print_table(f"{port} at {baud} baud", headings, rows)


def _word(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _module(module: "FoundModule") -> dict[str, object]:
    return {
        "address": module.address,
        "device": str(module.device),
        "position_counts": module.status.position,
        "servo_on": module.servo_on,
        "zero_known": module.zero_known,
        "new_address": module.newly_addressed,
    }


@app.command("status")
def status(
    port: Port,
    config: Config,
    model: Model = None,
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
    trust_zero: TrustZero = False,
    as_json: Json = False,
) -> None:
    """Show where the joints are. Moves nothing; a board in motion is stopped."""
    with opened(port, config, model, trust_zero=trust_zero) as arm:
        due = arm.connect()
        if due and not as_json:
            console.out.print(f"rezero is due: {', '.join(due)} (servo home)")
        try:
            while True:
                _print_state(arm.cycle(), due, as_json=as_json, line=watch)
                if not watch:
                    break
                time.sleep(0.2)
        except KeyboardInterrupt:
            pass


def _print_state(state: "ArmState", due: tuple[str, ...], *, as_json: bool, line: bool) -> None:
    document = {**state.to_mapping(), "rezero_due": list(due)}
    if as_json and line:
        sys.stdout.write(json.dumps(document, allow_nan=False) + "\n")
        sys.stdout.flush()
    elif as_json:
        console.print_json(document)
    else:
        servo_motion.print_state(state)


@app.command("stop")
def stop(
    port: Port,
    config: Config,
    release: Annotated[
        bool, typer.Option("--release", help="Switch the motors off: the arm falls.")
    ] = False,
    yes: Yes = False,
) -> None:
    """Stop every joint smoothly; the joints that were on go on holding."""
    from nico_selfmodel.errors import RobotError

    if release:
        ask("Switch the motors off? What gravity pulls falls.", yes=yes)
    with opened(port, config) as arm:
        try:
            arm.connect()
        except RobotError as error:
            raise type(error)(f"{error}. {_stop_the_rest(arm, release)}") from error
        arm.stop()
        if release:
            arm.release()
        state = arm.cycle()
    held = [name for name, on in zip(state.joints, state.enabled, strict=True) if on]
    console.out.print(f"stopped; holding: {', '.join(held) or 'none'}", markup=False)


def _stop_the_rest(arm: "ArmController", release: bool) -> str:
    """Stop or release the joints that answer though others do not; return what came of it."""
    from nico_selfmodel.servos import stop_what_answers

    done, _ = stop_what_answers(arm.axes, release=release)
    what = "switched off" if release else "stopped"
    return f"{what.capitalize()} all the same: {', '.join(done)}" if done else f"None was {what}"


@app.command("serve")
def serve(
    port: Port,
    config: Config,
    model: Model = None,
    tcp_port: Annotated[
        int, typer.Option("--tcp-port", min=0, max=65535, help="0 chooses a free one.")
    ] = 4747,
    trust_zero: TrustZero = False,
) -> None:
    """Let other processes of this machine read the arm, and one at a time command it."""
    from nico_selfmodel.servos import ArmLoop, MotorServer

    arm = opened(port, config, model, trust_zero=trust_zero)
    with ExitStack() as stack:
        stack.callback(arm.close)
        due = arm.connect()
        loop = stack.enter_context(ArmLoop(arm))
        server = stack.enter_context(MotorServer(loop, tcp_port))
        if due:
            console.out.print(f"rezero is due: {', '.join(due)} (servo home)")
        console.out.print(f"motor server on 127.0.0.1:{server.port}, Ctrl-C ends it")
        sys.stdout.flush()
        server.wait()
