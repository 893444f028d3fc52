"""YAML files in which no key stands twice."""

from typing import Any

import yaml


class UniqueKeys:
    """Part of a YAML loader: refuses a key that stands twice, of which the last would win."""

    def construct_document(self, node: Any) -> Any:
        """Return the content of a document.

        Raises:
            yaml.YAMLError: If a key stands twice, or the document is not valid.
        """
        # All before any: merging (`<<`) writes the merged keys into the nodes themselves.
        todo, seen = [node], set()
        while todo:
            node_here = todo.pop()
            if id(node_here) in seen:
                continue
            seen.add(id(node_here))
            if isinstance(node_here, yaml.MappingNode):
                _require_unique(node_here)
                todo += [part for pair in node_here.value for part in pair]
            elif isinstance(node_here, yaml.SequenceNode):
                todo += node_here.value
        return super().construct_document(node)  # type: ignore[misc]


def _require_unique(mapping: yaml.MappingNode) -> None:
    lines: dict[tuple[str, str], int] = {}
    for key in (key for key, _ in mapping.value if isinstance(key, yaml.ScalarNode)):
        name = (key.tag, key.value)
        if name in lines:
            problem = f"key {key.value!r} stands here and in line {lines[name]}"
            raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
        lines[name] = key.start_mark.line + 1
