"""YAML files of ROS parameters: read within bounds, and with the kinds of values that ROS gives them."""

from __future__ import annotations

import re
import warnings
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from lidarcli.errors import UnreadableError
from lidarcli.tomlfiles import MAX_DEPTH, read_text

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node, ScalarNode

MAX_YAML_BYTES = 1 << 17
"""Most bytes of a file: all parameters of Nav2 take some 20,000, and parsing is slow."""
_TRUTHS = dict.fromkeys(("y", "yes", "true", "on"), True) | dict.fromkeys(("n", "no", "false", "off"), False)
_INTEGER = re.compile(r"[-+]?(0[0-7]{0,21}|0x[0-9a-f]{1,16}|[1-9][0-9]{0,18})", re.IGNORECASE)
_TAG = "tag:yaml.org,2002:"


def read_yaml(file: str, what: str) -> dict[str, Any]:
    """Read a YAML file, which errors call a `what` (zone file), into dicts, lists, texts, numbers, booleans and None.

    As in ROS there are no aliases, and thus no merges, of which a few lines can be made to take hours.

    Raises
    ------
    UnreadableError
        There is no such file, it is too large, or it is no YAML with keys.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.nodes import MappingNode

    text = read_text(file, what, "YAML", most=MAX_YAML_BYTES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            root = YAML(typ="safe", pure=True).compose(text)
    except RecursionError as err:
        raise UnreadableError(f"{file}: more than {MAX_DEPTH} levels") from err
    # Whatever the parser stumbles over, the file is at fault: it may come from anywhere.
    except Exception as err:
        raise UnreadableError(f"{file}: not valid YAML: {_reason(err)}") from err
    if not isinstance(root, MappingNode):
        raise UnreadableError(f"{file}: not valid YAML of a {what}: it has no keys")
    values: dict[str, Any] = _value(file, root, set(), 0)
    return values


def _value(file: str, node: Node, seen: set[int], depth: int) -> Any:
    """Return the value of a node."""
    from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

    place = f"{file}: line {node.start_mark.line + 1}"
    if id(node) in seen:
        raise UnreadableError(f"{place}: an anchor that is used twice, which ROS does not know")
    if depth > MAX_DEPTH:
        raise UnreadableError(f"{place}: more than {MAX_DEPTH} levels")
    seen.add(id(node))
    if isinstance(node, ScalarNode):
        return _scalar(node)
    if isinstance(node, SequenceNode):
        return [_value(file, item, seen, depth + 1) for item in node.value]
    assert isinstance(node, MappingNode)
    values: dict[str, Any] = {}
    for key, value in node.value:
        name = str(key.value) if isinstance(key, ScalarNode) else ""
        if not name:
            raise UnreadableError(f"{place}: a key that is no name")
        if name in values:
            raise UnreadableError(f"{file}: line {key.start_mark.line + 1}: key '{name}' is there twice")
        values[name] = _value(file, value, seen, depth + 1)
    return values


def _scalar(node: ScalarNode) -> Any:
    """Return a text, number, boolean or None."""
    text = str(node.value)
    kind = str(node.tag).removeprefix(_TAG)
    if kind == "null":
        return None
    # Quoted values have a style.
    if kind in {"bool", "str"} and not node.style and text.lower() in _TRUTHS:
        return _TRUTHS[text.lower()]
    # As in the parser of ROS: 030 is octal, and neither 1_5 nor 0o17 is a number.
    if kind == "int" and _INTEGER.fullmatch(text):
        digits = text.lower().lstrip("+-")
        return int(text, 16 if digits.startswith("0x") else 8 if digits.startswith("0") else 10)
    if kind in {"int", "float"} and not set(text.lower()) & set("_oxb:"):
        with suppress(ValueError):
            return float(text.lower().replace(".inf", "inf").replace(".nan", "nan"))
    return text


def _reason(err: Exception) -> str:
    """Return the cause that a parser tells, in one line, with the place."""
    mark = getattr(err, "problem_mark", None)
    told = [text for name in ("context", "problem") if (text := getattr(err, name, None))]
    if mark is None or not told:
        return " ".join(str(err).split()) or type(err).__name__
    return f"line {mark.line + 1}: {', '.join(told)}"
