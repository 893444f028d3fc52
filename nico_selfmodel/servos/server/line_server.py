"""Lines in, lines out, over TCP on this machine: for many clients, whatever they do."""

import asyncio
import json
import socket
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from contextlib import suppress
from typing import Any

LOOPBACK = "127.0.0.1"
LONGEST_LINE = 65536
IDLE = 30.0
"""After so long without a line a client is hung up on [s]."""
MOST_CLIENTS = 128
"""Where one more comes, the one that was silent for longest is hung up on."""
_UNFINISHED = 5.0
"""Time from the first byte of a line to its last, and for a client to read its answers [s]."""
_LAST_WORDS = 0.5
"""How long a client that is hung up on may go on talking [s], lest it miss why."""
_NEXT_LOOK = 0.05
"""How long a server that ends waits before it looks who is still there [s]."""
_PACE = 2e-3
"""Time from one ordinary request to the next, whoever asks [s]."""
_ORDINARY = 2048
"""A line of so many bytes takes twice the time."""


class LineClient:
    """One connection."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Take a connection."""
        self._reader, self._writer = reader, writer
        self.heard = time.monotonic()
        """When it last sent a line, or came [s]."""
        self.kept = False
        """Whether it is not to make room for another."""

    async def line(self, idle: float) -> bytes | None:
        """Return the next line, None where the client hung up.

        Args:
            idle: How long to wait for it to begin [s].

        Raises:
            TimeoutError: If none begins in time.
            ValueError: If it is too long, or does not end in time.
        """
        async with asyncio.timeout(idle):
            first = await self._reader.read(1)
        try:
            async with asyncio.timeout(_UNFINISHED):
                rest = b"" if first in b"\n" else await self._reader.readuntil(b"\n")
        except asyncio.IncompleteReadError:
            return None
        except asyncio.LimitOverrunError:
            raise ValueError(f"a line has at most {LONGEST_LINE} bytes") from None
        except TimeoutError:
            raise ValueError(f"a line must end within {_UNFINISHED:g} s") from None
        self.heard = time.monotonic()
        return first + rest or None

    async def say(self, answer: Mapping[str, Any]) -> None:
        """Send an answer.

        Raises:
            TimeoutError: If the client does not read.
            OSError: If it is gone.
        """
        self._writer.write(json.dumps(answer, allow_nan=False).encode() + b"\n")
        async with asyncio.timeout(_UNFINISHED):
            await self._writer.drain()

    async def hang_up(self) -> None:
        """Close the connection after the client had time to read what it was told."""
        with suppress(OSError, TimeoutError):
            self._writer.write_eof()
            async with asyncio.timeout(_LAST_WORDS):
                while await self._reader.read(LONGEST_LINE):
                    pass
        self.cut()

    def cut(self) -> None:
        """Close the connection at once."""
        self._writer.transport.abort()


Answer = Callable[[bytes, LineClient], Awaitable[tuple[Mapping[str, Any], bool]]]
"""From a line and who sent it to the answer, and whether to go on listening to this client."""


class LineServer:
    """Serves lines in a thread of its own while it runs; no client can keep another from it."""

    def __init__(
        self, answer: Answer, hung_up: Callable[[LineClient], None], *, idle: float = IDLE
    ) -> None:
        """Describe a server; nothing listens before `start`.

        Args:
            answer: What makes answers; is run in the server's thread.
            hung_up: Called there when a connection was closed.
            idle: After how long without a line a client is hung up on [s].
        """
        self._answer, self._hung_up, self._idle = answer, hung_up, idle
        self._clients: dict[asyncio.Task, LineClient] = {}
        self._turn = asyncio.Lock()
        self._ended = asyncio.Event()
        self._events: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

    def start(self, port: int) -> int:
        """Listen.

        Args:
            port: TCP port on the loopback interface; 0 lets the system choose.

        Returns:
            The port.

        Raises:
            OSError: If it cannot be listened at.
        """
        listener = socket.create_server((LOOPBACK, port), backlog=MOST_CLIENTS)
        self._events = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._run, args=(listener,), name="line server", daemon=True
        )
        self._thread.start()
        return listener.getsockname()[1]

    def stop(self) -> None:
        """Hang up on everybody and end the thread."""
        thread, self._thread = self._thread, None
        if thread is not None and self._events is not None:
            self._events.call_soon_threadsafe(self._ended.set)
            thread.join()

    def spawn(self, work: Coroutine[Any, Any, Any]) -> asyncio.Task:
        """Do something in the server's thread; from there only."""
        assert self._events is not None
        return self._events.create_task(work)

    async def wait_turn(self, line: bytes) -> None:
        """Wait as long as an ordinary request has to, so that a flood of them leaves time."""
        async with self._turn:
            await asyncio.sleep(_PACE * (1.0 + len(line) / _ORDINARY))

    def _run(self, listener: socket.socket) -> None:
        assert self._events is not None
        with asyncio.Runner(loop_factory=lambda: self._events) as runner:  # type: ignore[arg-type]
            runner.run(self._serve(listener))

    async def _serve(self, listener: socket.socket) -> None:
        server = await asyncio.start_server(self._attend, sock=listener, limit=LONGEST_LINE)
        await self._ended.wait()
        # Let nobody in before it is closed: asyncio would lose those who are half inside.
        with suppress(NotImplementedError):  # Windows' own loop lets in otherwise
            asyncio.get_running_loop().remove_reader(listener)
        await asyncio.sleep(0)
        server.close()
        # Some may have been let in whom nobody attends to yet: their turn comes, and ends.
        while others := asyncio.all_tasks() - {asyncio.current_task()}:
            for task in list(self._clients):
                task.cancel()
            await asyncio.wait(others, timeout=_NEXT_LOOK)

    async def _attend(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Answer line after line until the client hangs up, or has to."""
        client, task = LineClient(reader, writer), asyncio.current_task()
        assert task is not None
        self._make_room()
        self._clients[task] = client
        try:
            await self._talk(client)
        except (OSError, TimeoutError, asyncio.CancelledError):
            pass  # it is gone, or as good as gone, or the server ends
        finally:
            self._clients.pop(task, None)
            client.cut()
            self._hung_up(client)

    async def _talk(self, client: LineClient) -> None:
        while True:
            try:
                line = await client.line(self._idle)
            except ValueError as error:
                await client.say({"ok": False, "error": str(error)})
                break
            if line is None:
                return
            answer, go_on = await self._answer(line, client)
            await client.say(answer)
            if not go_on:
                break
        await client.hang_up()

    def _make_room(self) -> None:
        """Hang up on whoever was silent for longest, where there are too many."""
        others = [task for task, client in self._clients.items() if not client.kept]
        if len(self._clients) >= MOST_CLIENTS and others:
            silent = min(others, key=lambda task: self._clients[task].heard)
            # Not when its task ends: who comes at the same time would hang up on it again.
            self._clients.pop(silent).cut()
