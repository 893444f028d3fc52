"""YAML files in which no key stands twice."""

from typing import Any

import yaml


class UniqueKeys:
    """Part of a YAML loader: refuses a key that stands twice, of which the last would win."""

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping.

        Raises:
            yaml.YAMLError: If a key stands twice, or the mapping is not valid.
        """
        lines: dict[str, int] = {}
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in lines:
                problem = f"key {key.value!r} stands here and in line {lines[key.value]}"
                raise yaml.constructor.ConstructorError(None, None, problem, key.start_mark)
            lines[key.value] = key.start_mark.line + 1
        return super().construct_mapping(node, deep)  # type: ignore[misc]
