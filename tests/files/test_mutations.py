"""Whatever stands in a file: a command does its work, or says in one line why it does not.

`NICO_MUTATIONS=2000 pytest -m slow tests/files/test_mutations.py` spoils 2000 files in place of
150, and 100 more for processes of their own in place of 8; `NICO_MUTATION_SEED` is the first seed.
A failure names its seed: `NICO_MUTATIONS=1` and this one repeat it.
"""

import json
import os
import shutil
from itertools import islice
from pathlib import Path
from subprocess import CompletedProcess

import numpy as np
import pytest

from nico_selfmodel.servos import SimulatedBus
from nico_selfmodel.servos.pic_servo.simulated.module import SimulatedModule

from .mutations import NUMBERS, TEXTS, spoil
from .small_inputs import KINDS, WORDS, make_sound_inputs
from .spoilt_runs import (
    MEMORY,
    PEAK,
    Run,
    complaint,
    complaint_of_process,
    judged,
    listing,
    run_of_word,
    runs_of,
)

FILES = int(os.environ.get("NICO_MUTATIONS", "150"))
FIRST = int(os.environ.get("NICO_MUTATION_SEED", "0"))
PROCESSES = max(FILES // 20, 8)


@pytest.fixture(scope="module")
def sound(tmp_path_factory, command):
    """Return a folder of sound inputs, and what the commands that read them fill in."""
    folder = tmp_path_factory.mktemp("sound")
    modules = [SimulatedModule() for _ in range(3)]
    for address, module in enumerate(modules, 1):
        module.address, module.was_addressed = address, True
    with SimulatedBus(modules) as bus:
        yield folder, {**make_sound_inputs(folder, command), "port": bus.name}


def drawn(first, count):
    """Yield kinds in turn, and a seed for each, which alone says both."""
    return [(KINDS[seed % len(KINDS)], seed) for seed in range(first, first + count)]


def _can_be_given(word):
    """Whether a process can be started with a word."""
    try:
        return b"\0" not in os.fsencode(word)
    except UnicodeEncodeError:
        return False


def room_for(tmp_path, seed):
    room = tmp_path / str(seed)
    room.mkdir()
    return room


def forget_peak():
    """Let the kernel count the most that this process holds from now on, not since it began."""
    Path("/proc/self/clear_refs").write_text("5")


def report(found, runs):
    return "\n".join([f"{len(found)} of {runs} commands end as none may:", *found])


@pytest.mark.slow
def test_spoilt_files_are_read_or_refused_in_one_line(sound, tmp_path, command):
    forget_peak()
    found, runs = [], 0
    for kind, seed in drawn(FIRST, FILES):
        for run in runs_of(kind, seed, *sound, room_for(tmp_path, seed)):
            runs += 1
            if wrong := complaint(run, command):
                found.append(f"{run.label}\n    {wrong}")
                print(found[-1], flush=True)
    held = 1024 * int(PEAK.search(Path("/proc/self/status").read_text())[1])
    print(f"{FILES} files, {runs} commands, {held / 2**20:.0f} MB")
    assert not found, report(found, runs)
    assert held < MEMORY


@pytest.mark.slow
def test_odd_words_are_taken_or_refused_in_one_line(sound, tmp_path, command):
    odd = [word for word in (*NUMBERS, *TEXTS) if _can_be_given(word)]
    rng, found = np.random.default_rng(FIRST), []
    for number in range(FILES):
        reader = WORDS[number % len(WORDS)]
        room = room_for(tmp_path, number)
        run = run_of_word(reader, odd[rng.integers(len(odd))], *sound, room)
        if wrong := complaint(run, command):
            found.append(f"{run.label}\n    {wrong}")
            print(found[-1], flush=True)
    assert not found, report(found, FILES)


@pytest.mark.slow
def test_a_process_of_limited_memory_ends_as_well(sound, tmp_path):
    found = []
    for kind, seed in drawn(FIRST + 1_000_000, PROCESSES):
        runs = runs_of(kind, seed, *sound, room_for(tmp_path, seed))
        run = next(islice(runs, seed % len(kind.readers), None))
        if wrong := complaint_of_process(run):
            found.append(f"{run.label}\n    {wrong}")
            print(found[-1], flush=True)
    assert not found, report(found, PROCESSES)


@pytest.mark.slow
def test_sound_files_are_read(sound, tmp_path, command):
    """Commands that refuse everything would pass the others."""
    folder, fill = sound
    refused = []
    for kind in {kind.folder: kind for kind in KINDS}.values():
        room = room_for(tmp_path, kind.folder)
        for run in runs_of(kind, None, folder, fill, room):
            if "/dev/null" in run.words:  # what moves motors gets none here
                continue
            done = command(*run.words, stdin=run.stdin)
            if done.returncode not in (None, 0, 1):
                refused.append(f"{' '.join(run.words[:3])}: {done.stderr}")
            elif wrong := complaint(run, lambda *_, of=done, **__: of):
                refused.append(f"{run.label}: {wrong}")
    assert not refused, "\n".join(refused)


@pytest.mark.parametrize("name", ["samples.csv", "self_model.yaml", "small.urdf", "scene.json"])
def test_a_seed_spoils_a_file_alike_again(tmp_path, name):
    text = {"samples.csv": "a,b\n1,2\n", "small.urdf": '<robot name="a"><link name="b"/></robot>\n'}
    content, spoilt = text.get(name, json.dumps({"a": [1.0, {"b": "c"}]})), []
    for seed in (*range(20), *range(20)):
        folder = room_for(tmp_path, len(spoilt))
        (folder / name).write_text(content)
        way = spoil(folder / name, np.random.default_rng(seed))
        spoilt.append((way, listing(folder)))
    assert spoilt[:20] == spoilt[20:]
    assert len({way for way, _ in spoilt}) > 10
    assert sum(found != {name: content.encode()} for _, found in spoilt) > 20


@pytest.mark.parametrize(
    ("code", "out", "err", "wrong"),
    [
        (0, "1.5\n", "", None),
        (0, "1.5 nan\n", "", "prints"),
        (1, "-inf\n", "", "prints"),
        (2, "", "nico-selfmodel: the file is empty\n", None),
        (2, "", "nico-selfmodel: warning: odd\nnico-selfmodel: too odd\n", None),
        (2, "", "nico-selfmodel: one\nnico-selfmodel: two\n", "2 lines"),
        (2, "", "", "0 lines"),
        (0, "", "nico-selfmodel: all is well\n", "1 lines"),
        (2, "", "Traceback (most recent call last):\n", "not ours"),
        (2, "", "nico-selfmodel: 'float' object is not iterable\n", "Python's words"),
        (2, "", "nico-selfmodel: \x1b[31mred\n", "a terminal obeys"),
        (-11, "", "", "exit code -11"),
    ],
)
def test_the_judge_sees_what_is_wrong(tmp_path, code, out, err, wrong):
    (tmp_path / "out").mkdir()
    run = Run("a run", ("predict",), "", tmp_path)
    said = judged(run, CompletedProcess([], code, out, err), listing(tmp_path))
    assert (said is None) if wrong is None else wrong in str(said)


def test_the_judge_sees_what_was_written(tmp_path):
    (tmp_path / "out").mkdir()
    run, before = Run("a run", ("predict",), "", tmp_path), listing(tmp_path)
    (tmp_path / "out" / "a.json").write_text('{"a": [NaN]}')
    refused = CompletedProcess([], 2, "", "nico-selfmodel: no\n")
    assert "changed" in str(judged(run, refused, before))
    assert "into a.json" in str(judged(run, CompletedProcess([], 0, "", ""), before))
    shutil.move(tmp_path / "out" / "a.json", tmp_path / "out" / ".a.part")
    assert "leaves .a.part" in str(judged(run, CompletedProcess([], 0, "", ""), before))
