"""Reader of YAML files as people write them: YAML 1.2, no key twice."""

import re
from pathlib import Path
from typing import Any, ClassVar

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
_KEPT = ("null", "merge")  # of PyYAML's
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
    import yaml

    sizes = dict[int, int]()  # of nodes, by their identity

    class Loader(yaml.SafeLoader):
        """Loader of this text alone: resolvers are the class's."""

        yaml_implicit_resolvers: ClassVar[Any] = {
            first: [(tag, words) for tag, words in known if tag.removeprefix(_TAG) in _KEPT]
            for first, known in yaml.SafeLoader.yaml_implicit_resolvers.items()
        }

        def compose_node(self, parent: Any, index: Any) -> Any:
            """Count what aliases unfold to: a short text may stand for more than any memory holds."""
            named = self.check_event(yaml.AliasEvent)
            node = super().compose_node(parent, index)
            if named and id(node) not in sizes:
                raise ValueError(f"line {node.start_mark.line + 1}: it holds itself")
            if not named:
                pairs = isinstance(node, yaml.MappingNode)
                held = [] if isinstance(node, yaml.ScalarNode) else node.value
                parts = [part for pair in held for part in pair] if pairs else held
                sizes[id(node)] = 1 + sum(sizes[id(part)] for part in parts)
            if sizes[id(node)] > _MOST:
                raise ValueError(f"it unfolds to over {_MOST} values")
            return node

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            """Refuse a key that stands twice; of two the last would win."""
            seen = set[Any]()
            for part in (
                key for key, _ in node.value if isinstance(key, yaml.ScalarNode) and key.value != "<<"
            ):
                if (key := self.construct_object(part)) in seen:
                    raise ValueError(
                        f"key {key!r} stands twice in the mapping of line {node.start_mark.line + 1}"
                    )
                seen.add(key)
            return super().construct_mapping(node, deep)

    for tag, words in _SCALARS.items():
        Loader.add_implicit_resolver(_TAG + tag, re.compile(f"^({words})$"), None)
    Loader.add_constructor(
        _TAG + "int", lambda _, node: int(node.value, 0 if node.value[1:2] in "ox" else 10)
    )
    try:
        return yaml.load(text, Loader)
    except yaml.MarkedYAMLError as error:
        place = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise ValueError(place + ", ".join(filter(None, (error.context, error.problem)))) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise ValueError(first_line(error)) from None
