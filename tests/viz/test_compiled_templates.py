"""Templates of reports are compiled once, as modules are; with no place to keep them, each time."""

import sys

import jinja2
import pytest

from nico_selfmodel.viz.reports import compiled_templates
from nico_selfmodel.viz.reports.page import page_environment


@pytest.fixture
def compiled(monkeypatch, tmp_path):
    """Keep bytecode in a folder of the test; return names that were compiled, and the folder."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    monkeypatch.setattr(compiled_templates, "_TEMPLATES", tmp_path)
    names, compile_template = [], jinja2.Environment.compile

    def compile_and_tell(self, source, name=None, *args, **kwargs):
        names.append(name)
        return compile_template(self, source, name, *args, **kwargs)

    monkeypatch.setattr(jinja2.Environment, "compile", compile_and_tell)
    return names, tmp_path


def read():
    return page_environment().get_template("parts.html.j2")


def test_a_template_is_compiled_by_the_first_run_only(compiled):
    names, _ = compiled
    read()
    read()
    assert names == ["parts.html.j2"]


def test_a_damaged_file_is_compiled_anew(compiled):
    names, folder = compiled
    read()
    (kept,) = folder.glob("__pycache__/*.pyc")
    for content in (b"", b"nonsense", kept.read_bytes()[:-9]):
        kept.write_bytes(content)
        read()
    assert names == 4 * ["parts.html.j2"]


def test_where_nothing_can_be_written_or_shall_be_templates_are_compiled_each_time(
    compiled, monkeypatch
):
    names, folder = compiled
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    read()
    assert not list(folder.iterdir())
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    (folder / "__pycache__").write_text("a file where the folder should be")
    read()
    assert names == 2 * ["parts.html.j2"]
