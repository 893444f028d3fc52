"""YAML as text: the one loader and the one dumper for every file of ours.

A first pass over the parser's events, which recurse nowhere, refuses what would take the second
one, PyYAML's own construction, the stack, the memory or the day: deep nests, aliases that multiply,
numbers of a thousand digits. Numbers are YAML 1.2's: `1e-3` is one, which YAML 1.1 takes for text.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import yaml

from nico_selfmodel.errors import DataError
from nico_selfmodel.names import shown

DEEPEST = 32
"""Lists and mappings that may stand in each other."""
MOST_VALUES = 3_000_000
"""Values that a document may have, aliases written out; 100 characters of text count as one. The
largest of ours are covariances: of 1,700 parameters here, of 560 where corners of 40 tags are
learned."""
_LONGEST_NUMBER = 64
_TOO_DEEP = "exceeded maximum nesting depth"
_LARGEST_INTEGER = 2**128
"""A seed has 128 bits; nothing else comes near."""
_CORE = "tag:yaml.org,2002:"
_TAGS = {_CORE + kind for kind in ("str", "int", "float", "bool", "null", "map", "seq")}
_FLOAT = re.compile(r"^[-+]?(?:\d[\d_]*(?:\.[\d_]*)?|\.\d[\d_]*)[eE][-+]?\d+$")


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # pyright: ignore
    """Safe loading, fast where the C library is there."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Merge; of what is overridden drop the old, which PyYAML 6.0.4 would merge from here."""
        super().flatten_mapping(node)
        pairs = {}
        for pair in node.value:
            name, _ = pair
            is_word = isinstance(name, yaml.ScalarNode)
            pairs[(name.tag, name.value) if is_word else id(name)] = pair
        node.value = list(pairs.values())

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        value = super().construct_yaml_int(node)
        if abs(value) >= _LARGEST_INTEGER:
            raise _refused(node.start_mark, f"{shown(node.value)} is larger than any number here")
        return value

    def construct_yaml_float(self, node: yaml.ScalarNode) -> float:
        value = super().construct_yaml_float(node)
        if math.isinf(value) and "inf" not in node.value.lower():
            raise _refused(node.start_mark, f"{shown(node.value)} is larger than any number here")
        return value


_Loader.add_constructor(f"{_CORE}int", _Loader.construct_yaml_int)
_Loader.add_constructor(f"{_CORE}float", _Loader.construct_yaml_float)


class _Dumper(getattr(yaml, "CSafeDumper", yaml.SafeDumper)):  # pyright: ignore
    """Lists of plain values in one line; no aliases; text that does not print plainly escaped.

    PyYAML on its own writes a "next line" character such that it reads back as a space.
    """

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_text(self, text: str) -> yaml.ScalarNode:
        style = None if text.isprintable() else '"'
        return self.represent_scalar(f"{_CORE}str", text, style=style)

    def represent_values(self, values: list[Any]) -> yaml.SequenceNode:
        flat = all(isinstance(value, int | float | str | None) for value in values)
        return self.represent_sequence(f"{_CORE}seq", values, flow_style=flat)


_Dumper.add_representer(str, _Dumper.represent_text)
_Dumper.add_representer(list, _Dumper.represent_values)
# The dumper quotes text that the loader would take for a number, so both must know what is one.
for _both in (_Loader, _Dumper):
    _both.add_implicit_resolver(f"{_CORE}float", _FLOAT, list("-+.0123456789"))


def parse_yaml(text: str, where: str) -> Any:
    """Return what a YAML document says.

    Raises:
        DataError: If it is not YAML, a key stands twice, or it is deeper, larger or of other tags
            than any file of ours.
    """
    try:
        _check_events(text)
        return yaml.load(text, Loader=_Loader)  # `_Loader` is a safe one
    except yaml.YAMLError as error:
        raise DataError(f"{_place(where, error)}: not valid YAML: {_problem(error)}") from None
    # PyYAML lets these through for impossible dates and values that do not fit a tag.
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{where}: not valid YAML: {shown(str(error)).strip(_QUOTES)}") from None


def yaml_items(text: str, where: str, key: str, edit: Callable[[str, str], str]) -> list[str]:
    """Split a list in a document of another program, whose tags are that program's own.

    Args:
        text: The document, a mapping.
        where: Place for messages.
        key: Of the list in it.
        edit: From a key and its plain value, anywhere in the list, to the value it shall have.

    Returns:
        Each item as a YAML document of its own.

    Raises:
        DataError: If it is not YAML, holds other keys, or `key` is no list.
    """
    try:
        _check_events(text, any_tag=True)
        root = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise DataError(f"{_place(where, error)}: not valid YAML: {_problem(error)}") from None
    pairs = root.value if isinstance(root, yaml.MappingNode) else []
    if [name.value for name, _ in pairs] != [key]:
        raise DataError(f"{where}: expected the key {key!r} and nothing else at the top")
    items = pairs[0][1]
    if not isinstance(items, yaml.SequenceNode):
        raise DataError(f"{where}: {key!r} must be a list")
    for item in items.value:
        _edit_values(item, edit)
    return [yaml.serialize(item) for item in items.value]


def _edit_values(node: yaml.Node, edit: Callable[[str, str], str]) -> None:
    if isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _edit_values(item, edit)
    elif isinstance(node, yaml.MappingNode):
        for name, value in node.value:
            if isinstance(value, yaml.ScalarNode):
                value.value = edit(name.value, value.value)
            _edit_values(value, edit)


def yaml_text(content: Any) -> str:
    """Return plain Python values as YAML that `parse_yaml` reads back to the last bit.

    Raises:
        yaml.YAMLError: If something else than plain values is among them.
    """
    return yaml.dump(
        content,
        Dumper=_Dumper,
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=False,
        width=100,
    )


@dataclass
class _Nest:
    """A list or mapping that is not closed yet."""

    anchor: str | None
    is_mapping: bool
    values: int = 1
    keys: dict[tuple[str, str], int] = field(default_factory=dict)
    key_is_next: bool = True


def _check_events(text: str, *, any_tag: bool = False) -> None:
    """Refuse what no file of ours needs, before anything is built; other tags where they may be.

    Raises:
        yaml.YAMLError: If it is not YAML, or refused.
    """
    loader = _Loader(text)
    nests = [_Nest(None, is_mapping=False)]
    sizes: dict[str, int] = {}
    try:
        while loader.check_event():
            event = loader.get_event()
            if isinstance(event, yaml.NodeEvent):
                _note_key(nests[-1], event, loader)
            if isinstance(event, yaml.CollectionStartEvent):
                if not any_tag:
                    _check_tag(event)
                if len(nests) > DEEPEST:
                    raise _refused(event.start_mark, f"nested more than {DEEPEST} deep")
                is_mapping = isinstance(event, yaml.MappingStartEvent)
                nests.append(_Nest(event.anchor, is_mapping))
                continue
            if isinstance(event, yaml.CollectionEndEvent):
                nest = nests.pop()
                size, anchor = nest.values, nest.anchor
            elif isinstance(event, yaml.ScalarEvent):
                _check_scalar(event, loader, any_tag=any_tag)
                size, anchor = 1 + len(event.value) // 100, event.anchor
            elif isinstance(event, yaml.AliasEvent):
                size, anchor = _size_of_alias(event, sizes), None
            else:
                continue
            if anchor is not None:
                sizes[anchor] = size
            nests[-1].values += size
            if nests[-1].values > MOST_VALUES:
                raise _refused(event.start_mark, f"more than {MOST_VALUES} values")
    finally:
        loader.dispose()


def _note_key(nest: _Nest, event: yaml.NodeEvent, loader: Any) -> None:
    """Refuse a key that stands twice in its mapping, of which the last would win, or is no word."""
    if not nest.is_mapping:
        return
    if nest.key_is_next and isinstance(event, yaml.CollectionStartEvent):
        raise _refused(event.start_mark, "a list or mapping stands where a key belongs")
    if nest.key_is_next and isinstance(event, yaml.ScalarEvent):
        tag = event.tag or loader.resolve(yaml.ScalarNode, event.value, event.implicit)
        key, line = (tag, event.value), event.start_mark.line + 1
        if key in nest.keys:
            words = f"key {shown(event.value)} stands here and in line {nest.keys[key]}"
            raise _refused(event.start_mark, words)
        nest.keys[key] = line
    nest.key_is_next = not nest.key_is_next


def _check_scalar(event: yaml.ScalarEvent, loader: Any, *, any_tag: bool) -> None:
    """Refuse strange tags, and numbers of so many digits that reading them takes the day."""
    if not any_tag:
        _check_tag(event)
    if len(event.value) <= _LONGEST_NUMBER:
        return
    tag = event.tag or loader.resolve(yaml.ScalarNode, event.value, event.implicit)
    if tag in (f"{_CORE}int", f"{_CORE}float"):
        raise _refused(event.start_mark, f"a number of {len(event.value)} characters")


def _check_tag(event: yaml.ScalarEvent | yaml.CollectionStartEvent) -> None:
    if event.tag not in (None, "!", *_TAGS):
        raise _refused(event.start_mark, f"tag {shown(event.tag)} is not read here")


def _size_of_alias(event: yaml.AliasEvent, sizes: dict[str, int]) -> int:
    if event.anchor not in sizes:
        words = f"alias *{event.anchor} stands before or inside what it names"
        raise _refused(event.start_mark, words)
    return sizes[event.anchor]


def _refused(mark: Any, words: str) -> yaml.MarkedYAMLError:
    return yaml.constructor.ConstructorError(None, None, words, mark)


def _place(where: str, error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    return f"{where}, line {mark.line + 1}" if mark else where


def _problem(error: yaml.YAMLError) -> str:
    said = str(getattr(error, "problem", None) or error).splitlines()[0]
    # A parser that reads ahead, as that of PyYAML 6.0.4, comes to its own limit before ours.
    return f"nested more than {DEEPEST} deep" if said == _TOO_DEEP else said


_QUOTES = "'\""
