"""Commands on spoilt inputs, and whether they end as they must."""

import contextlib
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from .mutations import spoil
from .small_inputs import Kind, Reader

SECONDS, HANGING = 10.0, 60.0
"""Of the processor that a command may take, and of the clock, which neighbours share."""
ADDRESSES, MEMORY = 4 * 2**30, 2 * 2**30
"""Address space of a process, and what it may hold in memory [bytes]."""
_CODE = f"""
import atexit, os, pathlib, resource
resource.setrlimit(resource.RLIMIT_AS, ({ADDRESSES}, {ADDRESSES}))
own = pathlib.Path("/proc/self/status").read_text
atexit.register(lambda: pathlib.Path(os.environ["PEAK"]).write_text(own()))
from nico_selfmodel.cli.main import main
main()
"""
PEAK = re.compile(r"VmHWM:\s+(\d+) kB")
"""Of a process itself: what `wait4` tells begins with what its parent held."""
_NOT_FINITE = re.compile(r"(?<![\w.'\"/-])[-+]?(?:nan|inf|infinity)(?![\w.'\"-])", re.IGNORECASE)


_LONGEST = 1020
"""Of a refusal [characters]."""
_PYTHONS = (
    *("invalid literal", "object is not", "object has no", "could not convert", "is not in list"),
    *("out of bounds", "not supported between", "unhashable", "positional argument", "codec can't"),
    *("must be str", "list index", "broadcast", "inhomogeneous", "NoneType", "(-215", "Traceback"),
    *("dimension mismatch", "did not converge", "zero-size", "cannot convert", "math domain"),
    *("reshape", "operands", "array of size", "need at least one array", "max() arg", "min() arg"),
    *("Result too large", "out of range for", "int too large", "expected str", "Condition '"),
)
"""Words that Python, its libraries and Drake have for programmers."""


class TookTooLongError(BaseException):
    """Raised in a command by the clock; no command's own handlers catch it."""


@dataclass(frozen=True)
class Run:
    """A spoilt input and a command that reads it."""

    label: str
    words: tuple[str, ...]
    stdin: str
    folder: Path
    """What the command may touch, and nothing else."""


def runs_of(
    kind: Kind, seed: int | None, sound: Path, fill: dict[str, str], room: Path
) -> Iterator[Run]:
    """Yield a run for each command that reads an input, spoilt alike for all.

    Args:
        kind: The input.
        seed: Of how it is spoilt; not at all if None.
        sound: The sound inputs.
        fill: What the commands fill in besides the folders.
        room: An empty folder, which is empty again after the last run.
    """
    spoilt = room / "spoilt"
    shutil.copytree(sound / kind.folder, spoilt)
    way = "sound"
    if seed is not None:
        way = spoil(spoilt / kind.file, np.random.default_rng(seed))
    for number, reader in enumerate(kind.readers):
        folder = room / str(number)
        (folder / "out").mkdir(parents=True)
        it = _copied(spoilt, folder / kind.folder)
        words = [w.format(it=it, sound=sound, out=folder / "out", **fill) for w in reader.words]
        label = f"{kind.name}, seed {seed} ({way}): {' '.join(words)}"
        yield Run(label, tuple(words), _stdin(reader, it), folder)
        shutil.rmtree(folder)
    shutil.rmtree(spoilt)


def run_of_word(reader: Reader, odd: str, sound: Path, fill: dict[str, str], room: Path) -> Run:
    """Return a run of a command with an odd word in an empty folder."""
    (room / "out").mkdir()
    plain = {**fill, "sound": sound, "out": room / "out"}
    words = tuple(w.replace("{odd}", "\0").format(**plain).replace("\0", odd) for w in reader.words)
    return Run(f"{odd[:60]!r} for {{odd}} in {' '.join(reader.words)}", words, "", room)


def _copied(spoilt: Path, target: Path) -> Path:
    """Copy a folder in which not everything is a file."""
    target.mkdir()
    for path in spoilt.iterdir():
        there = target / path.name
        if path.is_symlink():
            there.symlink_to(path.readlink())
        elif path.is_fifo():
            os.mkfifo(there)
        elif path.is_dir():
            _copied(path, there)
        else:
            shutil.copyfile(path, there)
    return target


def _stdin(reader: Reader, it: Path) -> str:
    path = it / reader.stdin_from if reader.stdin_from else None
    if path is None or not path.is_file():
        return ""
    return path.read_bytes().decode("utf-8", "replace")


def complaint(run: Run, command) -> str | None:
    """Run a command here; return what is wrong with how it ended, None where nothing is.

    Args:
        run: The command.
        command: Runs it and returns code and streams.
    """
    before, began = listing(run.folder), time.process_time()
    try:
        with _clock(HANGING), _heard_beside_python() as heard:
            done = command(*run.words, stdin=run.stdin)
    except TookTooLongError:
        return f"hangs: {HANGING:g} s"
    except Exception as error:
        return f"traceback: {type(error).__name__}: {error}"
    if (seconds := time.process_time() - began) > SECONDS:
        return f"took {seconds:.1f} s of the processor"
    if heard:
        return f"printed beside Python: {heard[0][:300]!r}"
    return judged(run, done, before)


def complaint_of_process(run: Run) -> str | None:
    """Run a command as a process of limited memory; return what is wrong with how it ended."""
    before, began = listing(run.folder), time.monotonic()
    with (
        tempfile.NamedTemporaryFile("w+") as peak,
        tempfile.TemporaryFile("w+") as out,
        tempfile.TemporaryFile("w+") as err,
    ):
        process = subprocess.Popen(
            [sys.executable, "-c", _CODE, *run.words],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=err,
            env={**os.environ, "OMP_NUM_THREADS": "1", "NO_COLOR": "1", "MPLBACKEND": "Agg"}
            | {"PEAK": peak.name},
        )
        clock = threading.Timer(HANGING, process.kill)
        clock.start()
        _, status, usage = os.wait4(process.pid, 0)
        clock.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        streams = []
        for stream in (out, err):
            stream.seek(0)
            streams.append(stream.read())
        held = PEAK.search(peak.read())
    if time.monotonic() - began >= HANGING:
        return f"hangs: {HANGING:g} s"
    if (seconds := usage.ru_utime + usage.ru_stime) > SECONDS:
        return f"took {seconds:.1f} s of the processor"
    if held is not None and 1024 * int(held[1]) > MEMORY:
        return f"held {int(held[1]) // 1024} MB"
    done = subprocess.CompletedProcess(run.words, process.returncode, *streams)
    return judged(run, done, before)


def judged(run: Run, done, before: dict[str, bytes]) -> str | None:
    """Return what is wrong with how a command ended, None where nothing is."""
    code = done.returncode if done.returncode is not None else 0
    lines = done.stderr.splitlines()
    said = [line for line in lines if not line.startswith("nico-selfmodel: warning: ")]
    said = [line for line in said if not line.endswith(": done")]  # a stage that came to its end
    if code not in (0, 1, 2):
        return f"exit code {code}: {done.stderr[-300:]}"
    if any(not line.startswith("nico-selfmodel: ") for line in said):
        return f"a line that is not ours: {done.stderr[-300:]!r}"
    if len(said) != (1 if code == 2 else 0):
        return f"exit code {code} with {len(said)} lines: {done.stderr[-300:]!r}"
    unprintable = [c for c in done.stderr if not c.isprintable() and c != "\n"]
    if unprintable:
        return f"a line that a terminal obeys: {unprintable[:3]}"
    if code == 2:
        if vague := _vague(said[0]):
            return vague
        if listing(run.folder) != before:
            return f"exit code 2, and yet {_differences(before, listing(run.folder))} changed"
        return None
    return _not_finite(run, done.stdout)


def _vague(line: str) -> str | None:
    """Return why a refusal tells a person nothing."""
    said = line.removeprefix("nico-selfmodel: ")
    if len(said) > _LONGEST:
        return f"a refusal of {len(said)} characters"
    return f"Python's words: {said[:300]!r}" if any(w in said for w in _PYTHONS) else None


def listing(folder: Path) -> dict[str, bytes]:
    """Return every file in a folder with its content."""
    found = {}
    for path in sorted(folder.rglob("*")):
        plain = path.is_file() and not path.is_symlink()
        found[str(path.relative_to(folder))] = path.read_bytes() if plain else b""
    return found


def _differences(before: dict[str, bytes], after: dict[str, bytes]) -> str:
    names = {*before, *after}
    return ", ".join(sorted(n for n in names if before.get(n) != after.get(n)))


def _not_finite(run: Run, stdout: str) -> str | None:
    """Return where nan or inf stands in what a command printed or wrote, or what it left over."""
    if "--json" in run.words:
        try:
            document = json.loads(stdout)
        except ValueError as error:
            return f"prints no JSON: {error}: {stdout[:200]!r}"
        if not _finite(document):
            return "prints nan or inf"
    elif (match := _NOT_FINITE.search(stdout)) and match.group().strip() not in run.words:
        return f"prints {stdout[max(0, match.start() - 100) : match.end() + 50]!r}"
    for path in sorted((run.folder / "out").rglob("*")):
        if path.name.startswith(".") and not any(w.endswith(f"/{path.name}") for w in run.words):
            return f"leaves {path.name}"
        if path.suffix in (".json", ".yaml"):
            loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
            text = path.read_text()
            content = json.loads(text) if path.suffix == ".json" else yaml.load(text, loader)
            if not _finite(content):
                return f"writes nan or inf into {path.name}"
        if path.suffix in (".urdf", ".csv") and _NOT_FINITE.search(path.read_text()):
            return f"writes nan or inf into {path.name}"
    return None


def _finite(value) -> bool:
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, list):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


@contextlib.contextmanager
def _clock(seconds: float) -> Iterator[None]:
    def ring(*_):
        raise TookTooLongError

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _heard_beside_python() -> Iterator[list[str]]:
    """Give a list that holds, afterwards, what libraries wrote to the process' own streams."""
    heard: list[str] = []
    for stream in (sys.__stdout__, sys.__stderr__):
        if stream is not None:
            stream.flush()
    with tempfile.TemporaryFile() as file:
        kept = [os.dup(fd) for fd in (1, 2)]
        try:
            for fd in (1, 2):
                os.dup2(file.fileno(), fd)
            yield heard
        finally:
            for fd, old in zip((1, 2), kept, strict=True):
                os.dup2(old, fd)
                os.close(old)
            file.seek(0)
            if written := file.read().decode(errors="replace"):
                heard.append(written)
