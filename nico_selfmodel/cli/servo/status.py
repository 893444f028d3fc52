"""`nico-selfmodel servo status`: where the joints are."""

import json
import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import opened, print_state, tell_due

if TYPE_CHECKING:
    from nico_selfmodel.servos.arm_state import ArmState


def status(
    port: options.Port,
    config: options.Config,
    model: options.ModelOrNominal = None,
    watch: Annotated[bool, typer.Option("--watch", help="Go on until Ctrl-C.")] = False,
    trust_zero: options.TrustZero = False,
    as_json: options.AsJson = False,
) -> None:
    """Show where the joints are. Moves nothing; a board in motion is stopped."""
    with opened(port, config, model, trust_zero=trust_zero) as arm:
        due = arm.connect()
        if not as_json:
            tell_due(due)
        try:
            while True:
                _print(arm.cycle(), due, as_json=as_json, a_line=watch)
                if not watch:
                    break
                time.sleep(0.2)
        except KeyboardInterrupt:
            pass


def _print(state: "ArmState", due: tuple[str, ...], *, as_json: bool, a_line: bool) -> None:
    document = {**state.to_mapping(), "rezero_due": list(due)}
    if as_json and a_line:
        sys.stdout.write(json.dumps(document, allow_nan=False) + "\n")
        sys.stdout.flush()
    elif as_json:
        printer.as_json(document)
    else:
        print_state(state)
