"""Reader of YAML files as people write them: YAML 1.2, no key twice."""

import re
from collections import Counter
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar

import yaml

from dexgrasp_env.errors import InputError, first_line
from dexgrasp_env.files import read_file, readable
from dexgrasp_env.texts import plain_text

YAML_SUFFIXES = (".yaml", ".yml")
_SCALARS = {
    "bool": r"true|True|TRUE|false|False|FALSE",
    "int": r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+",
    "float": r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
}
"""Tag -> what is one in YAML 1.2 (core schema); PyYAML's are those of 1.1: 010 is 8, 1:30 is 90."""
_TAG = "tag:yaml.org,2002:"
_MOST = 100_000  # nodes, each as often as an alias names it


def read_yaml(path: Path, kind: str = "") -> Any:
    """Read a YAML file.

    Args:
        path: of the file.
        kind: of it, for messages.

    Raises:
        InputError: if it cannot be read, is too large, is none, or has a key twice.
    """
    what = f"{kind} {path}".strip()
    with readable(what):
        content = read_file(path, ".yaml")
    try:
        return parse_yaml(plain_text(content).decode())
    except ValueError as error:
        raise InputError(f"{what} is no YAML ({error})") from None


def parse_yaml(text: str) -> Any:
    """Return what a text of YAML 1.2 says.

    Raises:
        ValueError: in one line, if it is none, has a key twice, or unfolds to too much.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        place = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise ValueError(place + ", ".join(filter(None, (error.context, error.problem)))) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(first_line(error)) from None


class _Loader(yaml.SafeLoader):
    yaml_implicit_resolvers: ClassVar[Any] = {
        first: [(tag, words) for tag, words in known if tag.removeprefix(_TAG) in ("null", "merge")]
        for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
    } | {None: [(_TAG + tag, re.compile(f"^({words})$")) for tag, words in _SCALARS.items()]}

    def construct_document(self, node: Any) -> Any:
        """Return what a document says, once it is checked."""
        self._count(node, {})
        return super().construct_document(node)

    def _count(self, node: Any, counts: dict[Any, int]) -> int:
        """Return how many values a node stands for, with those that aliases name: a short text may mean too many.

        A key that stands twice is refused; of two the last would win.
        """
        line = node.start_mark.line + 1
        if node not in counts:
            counts[node] = 0  # not known yet
            parts = [] if isinstance(node, yaml.ScalarNode) else node.value
            if isinstance(node, yaml.MappingNode):
                plain = [key for key, _ in parts if isinstance(key, yaml.ScalarNode) and key.value != "<<"]
                for key, times in Counter(map(self.construct_object, plain)).items():
                    if times > 1:
                        raise ValueError(f"key {key!r} stands twice in the mapping of line {line}")
                parts = chain(*parts)
            counts[node] = 1 + sum(self._count(part, counts) for part in parts)
        if not counts[node]:
            raise ValueError(f"line {line}: it holds itself")
        if counts[node] > _MOST:
            raise ValueError(f"it unfolds to over {_MOST} values")
        return counts[node]


_Loader.add_constructor(_TAG + "int", lambda _, node: int(node.value, 0 if node.value[1:2] in "ox" else 10))
