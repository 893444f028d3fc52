"""The options of all commands, held against each other."""

import re
from collections import defaultdict

import pytest

from nico_selfmodel.cli.app import _tree
from nico_selfmodel.estimation.bending.steps import STEPS
from nico_selfmodel.estimation.body.body_options import STAGES, VARIANTS
from nico_selfmodel.estimation.cameras.camera_options import AUTO
from nico_selfmodel.model.camera_formats.formats import FORMATS
from nico_selfmodel.model.cameras.projection import LENSES
from nico_selfmodel.optimization.robust_solve import ROBUST_METHODS
from nico_selfmodel.planning.pose_selection import CRITERIA
from nico_selfmodel.plant.robots import ROBOTS
from nico_selfmodel.servos.makes import MAKES
from nico_selfmodel.systems.simulated.imperfections import IMPERFECTIONS
from nico_selfmodel.vision.boards.board_kinds import CHESSBOARD, KINDS
from nico_selfmodel.vision.markers.marker_sheet import PAPERS

SEVERAL_MEANINGS = {
    *("--out", "--seed", "--sensor", "--mirror", "--random"),  # what is made; of what; who watches
    *("--marker", "--encoders", "--seconds", "--robots", "--model", "--name"),
    *(
        "--camera",
        "--looks",
        "--head",
    ),  # its name, or which of them; how often, at what; what turns
    "--images",  # where to keep them, or whose they are
}
"""Options that are about another thing where another command has them, as their helps say."""
PRIVATE_WORDS = r"\b(eyes?|sight(ings?)?|pin(ned)?|play|blind|world|individuals?|believed)\b"


def leaves(command=None, path=()):
    command = command or _tree()
    for name, below in getattr(command, "commands", {}).items():
        if hasattr(below, "commands"):
            yield from leaves(below, (*path, name))
        else:
            yield " ".join((*path, name)), below


COMMANDS = dict(leaves())
GROUPS = [name for name, below in _tree().commands.items() if hasattr(below, "commands")]


def options_of(command):
    return {p.opts[0]: p.help for p in command.params if p.param_type_name == "option"}


def arguments_of(command):
    return [p.name for p in command.params if p.param_type_name == "argument"]


def test_an_option_of_two_commands_has_one_meaning():
    helps = defaultdict(set)
    for command in COMMANDS.values():
        for name, said in options_of(command).items():
            helps[name].add(said)
    assert {name for name, said in helps.items() if len(said) > 1} == SEVERAL_MEANINGS


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_the_words_of_the_field(name):
    command = COMMANDS[name]
    said = [command.help, *(p.help or "" for p in command.params), *options_of(command)]
    found = [words for words in said if re.search(PRIVATE_WORDS, words)]
    assert found == []


@pytest.mark.parametrize("path", [(), *((name,) for name in GROUPS)])
def test_a_list_of_commands_says_of_each_what_it_does_in_whole(path):
    group = _tree()
    for name in path:
        group = group.commands[name]
    context = group.make_context("", [], resilient_parsing=True)
    lines = group.get_help(context).partition("Commands:\n")[2].splitlines()
    assert len(lines) == len(group.commands)
    assert [line for line in lines if line.endswith("...")] == []


def test_the_help_of_an_option_names_no_type_of_python():
    for command in COMMANDS.values():
        options = [p for p in command.params if p.param_type_name == "option" and not p.is_flag]
        assert options
        assert [p.opts for p in options if not p.metavar] == []


def test_what_learns_takes_data_first_and_what_uses_a_model_takes_that_first():
    for name, command in COMMANDS.items():
        arguments = arguments_of(command)
        if name.startswith("calibrate "):
            assert arguments in (["dataset"], ["images"]), name
            assert "--out" in options_of(command)
        elif "dataset" in arguments and name != "convert":  # which uses no model
            assert arguments == ["model", "dataset"], name


@pytest.mark.parametrize(
    ("option", "names"),
    [
        ("--board", [kind for kind in KINDS if kind != CHESSBOARD]),
        ("--lens", [AUTO, *LENSES]),
        ("--effects", ["auto", "none", *STEPS]),
        ("--loss", ROBUST_METHODS),
        ("--format", FORMATS),
        ("--make", MAKES),
        ("--paper", PAPERS),
        ("--stage", STAGES),
        ("--variant", VARIANTS),
        ("--imperfections", IMPERFECTIONS),
        ("--arms", ["right", "left", "both"]),
        ("--robot", ROBOTS),
        ("--arm", ROBOTS["nico"]),
        ("--criterion", CRITERIA),
    ],
)
def test_the_help_of_an_option_names_all_that_can_be_chosen(option, names):
    said = [helps[option] for helps in map(options_of, COMMANDS.values()) if option in helps]
    assert said
    missing = {name for name in names for text in said if not re.search(rf"\b{name}\b", text)}
    assert missing == set()
