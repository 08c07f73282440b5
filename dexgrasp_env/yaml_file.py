"""Reader of YAML files as people write them: numbers of YAML 1.2, no key twice."""

import re
from pathlib import Path
from typing import Any

from dexgrasp_env.errors import InputError
from dexgrasp_env.files import read_file, readable


def read_yaml(path: Path, kind: str = "") -> Any:
    """Read a YAML file; numbers are those of YAML 1.2 (1e-4), and no mapping has a key twice.

    Args:
        path: of the file.
        kind: of it, for messages.

    Raises:
        InputError: if it cannot be read, is too large, or is none.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        """Loader of this file alone: resolvers are the class's."""

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            """Refuse a key that stands twice; of two the last would win."""
            seen = set[str]()
            for key in (key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
                if key in seen and key != "<<":
                    raise ValueError(
                        f"key {key!r} stands twice in the mapping of line {node.start_mark.line + 1}"
                    )
                seen.add(key)
            return super().construct_mapping(node, deep)

    exponent = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
    Loader.add_implicit_resolver("tag:yaml.org,2002:float", exponent, list("-+0123456789."))
    what = f"{kind} {path}".strip()
    with readable(what):
        content = read_file(path, ".yaml")
    try:
        return yaml.load(content.decode(), Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise InputError(f"{what} is no YAML ({str(error).splitlines()[0]})") from None
