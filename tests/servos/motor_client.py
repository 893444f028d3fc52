"""Somebody who talks to the motor server, one request at a time."""

import json
import socket
from contextlib import AbstractContextManager

from nico_selfmodel.errors import RobotError


class MotorClient(AbstractContextManager):
    """A connection to the motor server of this machine, with its lease if it took one."""

    def __init__(self, port):
        self.lease = None
        self._socket = socket.create_connection(("127.0.0.1", port), 10.0)
        self._lines = self._socket.makefile("rb")

    def __exit__(self, *_):
        self.close()

    def close(self):
        self._lines.close()
        self._socket.close()

    def ask(self, op, **values):
        request = {"op": op, **values}
        if self.lease is not None:
            request.setdefault("lease", self.lease)
        try:
            self._socket.sendall(json.dumps(request).encode() + b"\n")
            line = self._lines.readline()
        except ConnectionError:
            line = b""
        if not line:
            raise RobotError("the motor server has hung up")
        answer = json.loads(line)
        if not answer.pop("ok"):
            raise RobotError(answer["error"])
        return answer

    def take_lease(self, seconds=1.0):
        self.lease = self.ask("lease", seconds=seconds)["lease"]

    def state(self):
        return self.ask("state")["state"]

    def move(self, targets, speed=None):
        return self.ask("move", targets=targets, speed_rad_s=speed)["seconds"]

    def stop(self):
        self.ask("stop")
