"""`nico-selfmodel servo serve`: a server of the arm for other processes."""

import sys
from contextlib import ExitStack
from typing import Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import opened, tell_due


def serve(
    port: options.Port,
    config: options.Config,
    model: options.ModelOrNominal = None,
    tcp_port: Annotated[
        int, typer.Option("--tcp-port", min=0, max=65535, help="0 chooses a free one.")
    ] = 4747,
    trust_zero: options.TrustZero = False,
) -> None:
    """Let other processes of this machine read and command the arm.

    All may read it, one at a time commands it.
    """
    from nico_selfmodel.servos import ArmLoop, MotorServer

    arm = opened(port, config, model, trust_zero=trust_zero)
    with ExitStack() as stack:
        stack.callback(arm.close)
        due = arm.connect()
        loop = stack.enter_context(ArmLoop(arm))
        server = stack.enter_context(MotorServer(loop, tcp_port))
        tell_due(due)
        printer.line(f"motor server on 127.0.0.1:{server.port}, Ctrl-C ends it")
        sys.stdout.flush()
        server.wait()
