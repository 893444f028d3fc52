"""`nico-selfmodel servo steps`: record how joints follow steps of their commands."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from nico_selfmodel.cli import options, printer
from nico_selfmodel.cli.servo.opening import ask, opened, speed_of, stopping

if TYPE_CHECKING:
    from nico_selfmodel.dataset.motion.motion_recording import MotionRecording
    from nico_selfmodel.servos import ArmController


def steps(
    port: options.Port,
    config: options.Config,
    out: options.Out,
    joints: Annotated[list[str] | None, typer.Argument(help="Which; all if omitted.")] = None,
    count: Annotated[int, typer.Option("--steps", min=4, help="Steps of each joint.")] = 16,
    largest: Annotated[
        float, typer.Option("--largest-deg", min=0.1, max=360.0, help="Largest step [deg].")
    ] = 20.0,
    rest: Annotated[
        float,
        typer.Option(
            "--rest-s", min=0.2, max=60.0, help="How long each step is watched at rest [s]."
        ),
    ] = 0.6,
    speed: options.Speed = None,
    seed: options.SplitSeed = 0,
    trust_zero: options.TrustZero = False,
    yes: options.Yes = False,
    force: options.Force = False,
) -> None:
    """Record steps of joints for `calibrate servos`.

    One joint after another goes back and forth about where it stands; Ctrl-C stops it.
    """
    from nico_selfmodel.cli.inputs import name_after
    from nico_selfmodel.dataset.motion.motion_folder import save_motion
    from nico_selfmodel.files.whole import refuse_existing
    from nico_selfmodel.names import refuse_unknown

    refuse_existing(out, force=force, inputs=[config])
    name = name_after(out)
    with opened(port, config, trust_zero=trust_zero) as arm:
        for one in joints or ():
            refuse_unknown("joint", one, arm.joints)
        arm.connect()
        chosen = tuple(joints or arm.joints)
        arm.check_zero(chosen)
        rate = speed_of(speed, min(float(limit) for limit in arm.limits.speeds))
        plan = _plan(arm, chosen, math.radians(largest), count, seed)
        ask(f"Move {', '.join(chosen)} by up to {largest:g} deg, {count} times each?", yes=yes)
        arm.enable(chosen)
        found: list[MotionRecording] = []
        with printer.progress_bar() as progress:
            from nico_selfmodel.recording.step_recording import record_steps

            options = {"rest": rest, "name": name, "speed": rate, "source": f"steps of {arm.name}"}
            stopping(
                arm, lambda: found.append(record_steps(arm, plan, progress=progress, **options))
            )
    save_motion(found[0], out, force=force)
    printer.line(f"{len(found[0])} rows, {len(chosen)} joints: {out}")
    printer.line(f"learn from it: nico-selfmodel calibrate servos {out} --out {out}_response")


def _plan(
    arm: "ArmController", joints: tuple[str, ...], largest: float, count: int, seed: int
) -> dict[str, list[float]]:
    """Return the steps of each joint.

    Raises:
        ValueError: If a joint has no room.
    """
    import numpy as np

    from nico_selfmodel.planning.step_plan import planned_steps

    rng, state = np.random.default_rng(seed), arm.state()
    plan = {}
    for name in joints:
        k = arm.joints.index(name)
        low, high = arm.limits.positions[k].tolist()
        try:
            steps = planned_steps(float(state.q[k]), low, high, largest, count, rng)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        plan[name] = steps.tolist()
    return plan
