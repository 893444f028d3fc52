"""Motion capture in one process, its reader in another, newline-delimited JSON between them.

With `--serve` this script moves a simulated Nico and streams where its hand is; without, it starts
such a process and reads from it.
"""

import subprocess
import sys
import time

import numpy as np

from nico_selfmodel.systems import MotionCaptureClient, MotionCaptureServer

MARKERS = ("fiducial", "finger_tip", "hand")


def serve() -> None:
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    from nico_selfmodel import commands_of_angles
    from nico_selfmodel.systems import ImageQuality, MotionCaptureSender, NicoStation

    with MotionCaptureServer(MARKERS) as server:
        builder = DiagramBuilder()
        nico = builder.AddSystem(NicoStation("thesis", 1, quality=ImageQuality(1)))
        sender = builder.AddSystem(MotionCaptureSender(server, rate=50.0))
        builder.Connect(nico.GetOutputPort("p_WH_measured"), sender.get_input_port())
        simulator = Simulator(builder.Build())
        context = nico.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        pose = np.radians([[-40.0, 15.0, -35.0, -55.0]])
        arm = nico.arm
        command = commands_of_angles(nico.joints, arm.lower, arm.upper, pose)[0]
        nico.GetInputPort("encoders_commanded").FixValue(context, command)
        # A reader waits for a frame from when it has the port.
        print(server.address[1], flush=True)
        while server.clients == 0:
            time.sleep(0.05)
        simulator.set_target_realtime_rate(1.0)
        simulator.AdvanceTo(1.0)


def read() -> None:
    child = subprocess.Popen(
        [sys.executable, __file__, "--serve"], stdout=subprocess.PIPE, text=True
    )
    port = int(child.stdout.readline())
    with MotionCaptureClient(("127.0.0.1", port)) as client:
        frames = [client.next() for _ in range(40)]
    child.wait()
    seen = [f.positions["hand"] for f in frames if f.positions["hand"] is not None]
    print(f"{len(frames)} frames, {len(frames) - len(seen)} without the hand")
    print(f"the hand moved {1e3 * np.linalg.norm(seen[-1] - seen[0]):.0f} mm")


if __name__ == "__main__":
    serve() if "--serve" in sys.argv else read()
