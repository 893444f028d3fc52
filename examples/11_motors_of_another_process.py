"""Move a joint through the motor server: JSON lines over a socket, from any language.

Here server and boards (simulated ones) are in this process. With an arm, leave both out and start
`nico-selfmodel servo serve` elsewhere; it listens on port 4747.
"""

import json
import socket
import time

from nico_selfmodel.servos import (
    ArmController,
    ArmLoop,
    JointServo,
    MotorServer,
    ServoConfig,
    SimulatedBus,
)

elbow = JointServo("elbow", 1, 200_000, -1.5, 1.5, max_velocity=1.0, max_acceleration=4.0)
config = ServoConfig("one joint", (elbow,), baud=115200)
with SimulatedBus(1) as bus, ArmController.open(bus.name, config, trust_zero=True) as arm:
    arm.connect()
    with (
        ArmLoop(arm) as loop,
        MotorServer(loop, 0) as server,
        socket.create_connection(("127.0.0.1", server.port)) as connection,
        connection.makefile("rw") as lines,
    ):

        def ask(op, **values):
            """Send a request and return the answer; the arm stops where its lease runs out."""
            print(json.dumps({"op": op, **values}), file=lines, flush=True)
            answer = json.loads(lines.readline())
            if not answer.pop("ok"):
                raise RuntimeError(answer["error"])
            return answer

        lease = ask("lease", seconds=1.0)["lease"]
        ask("enable", lease=lease)  # only now the motor holds
        seconds = ask("move", lease=lease, targets={"elbow": 0.3})["seconds"]
        until = time.monotonic() + seconds + 0.3
        while time.monotonic() < until:
            ask("renew", lease=lease)
            time.sleep(0.1)
        state = ask("state")["state"]["joints"]["elbow"]
        print(f"after {seconds:.2f} s the elbow stands at {state['q_rad']:.2f} rad")
