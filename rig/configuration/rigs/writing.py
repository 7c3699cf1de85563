"""Changes single values in the text of a rig file, so that all other lines and comments stay."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import yaml

from rig.configuration.reading import Sources, asked, resolve


def with_section(text: str, key: str, section: Sequence[str], mark: str = "") -> str:
    """Return the text of a rig file with another section; all other lines stay.

    The section takes the place of the one that is there, or comes last.

    Args:
        text: YAML of a rig file, a mapping in block style.
        key: key of the section.
        section: its lines; the first is a comment above it.
        mark: words of the comment by which the line above an old section is known as the program's
            own, and is replaced too; a comment without them stays.
    """
    lines = text.rstrip("\n").split("\n")
    for name, value in _pairs(yaml.compose(text, Loader=yaml.SafeLoader)):
        if name.value == key:
            first, last = name.start_mark.line, last_line(value)
            above = lines[first - 1] if first > 0 else ""
            own = bool(mark) and above.startswith("# ") and mark in above
            lines[first - own : last + 1] = section
            return "\n".join(lines) + "\n"
    return "\n".join([*lines, "", *section]) + "\n"


def with_value(text: str, path: Sequence[str], value: str) -> str:
    """Return the text of a rig file with another value under a path of keys; all else stays.

    What lacks on the way to the value is added: in the mapping where it belongs, or at the end.

    Args:
        text: YAML of a rig file, a mapping in block style.
        path: keys from the outermost on, such as `("limits", "position")`.
        value: the value as it is written in YAML, on one line.
    """
    node: yaml.Node | None = yaml.compose(text, Loader=yaml.SafeLoader)
    for depth, key in enumerate(path):
        found = next((each for name, each in _pairs(node) if name.value == key), None)
        if found is None:
            return _added(text, node, key, _nested(path[depth + 1 :], value))
        node = found
        left = path[depth + 1 :]
        if left and not isinstance(node, yaml.MappingNode):
            # A plant may be given by the name of its model alone.
            named = text[node.start_mark.index : _end(node)].strip()
            inside = f"model: {named}, " if key == "plant" and named else ""
            return _replaced(text, node, f"{{{inside}{left[0]}: {_nested(left[1:], value)}}}")
    assert node is not None
    return _replaced(text, node, value)


def section_text(file: Path, key: str) -> str | None:
    """Return the lines of a section as a rig file or the nearest of its parents gives it, or None.

    Raises:
        ConfigError: a parent cannot be found.
        OSError: a file cannot be read.
    """
    text = file.read_text(encoding="utf-8")
    pairs = _pairs(yaml.compose(text, Loader=yaml.SafeLoader))
    for name, value in pairs:
        if name.value == key:
            lines = text.split("\n")[name.start_mark.line : last_line(value) + 1]
            return "\n".join(lines) + "\n"
    for name, value in pairs:
        if name.value == "parent" and value.value:
            sources = Sources()
            found = resolve("rig", asked("rig", value.value, sources), file.parent)
            return section_text(sources.finished(found), key)
    return None


def with_values(text: str, file: Path, values: Mapping[tuple[str, ...], str], remark: str) -> str:
    """Return the text of a rig file with other values under paths of keys.

    A section that the file inherits is copied from the parent first, with its comments, as a
    section of a file replaces all of its parent's.

    Args:
        text: YAML of the rig file.
        file: its path, from which its parents are found.
        values: path of keys -> value as it is written in YAML.
        remark: comment above a section that is copied, on one line.

    Raises:
        ConfigError: a parent cannot be found.
        OSError: a parent cannot be read.
    """
    for path, value in values.items():
        keys = [name.value for name, _ in _pairs(yaml.compose(text, Loader=yaml.SafeLoader))]
        inherited = section_text(file, path[0]) if path[0] not in keys else None
        if inherited is not None:
            text = f"{text.rstrip()}\n\n# {remark}\n{inherited}"
        text = with_value(text, path, value)
    return text


def last_line(node: yaml.Node) -> int:
    """Return the number of the last line, from 0, of a YAML value, without what follows it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return last_line(last[1] if isinstance(node, yaml.MappingNode) else last)
    return int(node.end_mark.line)


def _pairs(node: yaml.Node | None) -> list[tuple[yaml.Node, yaml.Node]]:
    return list(node.value) if isinstance(node, yaml.MappingNode) else []


def _end(node: yaml.Node) -> int:
    """Return the index in the text one past the last character of a YAML value."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(node, yaml.MappingNode) else last)
    return int(node.end_mark.index)


def _replaced(text: str, node: yaml.Node, value: str) -> str:
    start, end = node.start_mark.index, _end(node)
    # An empty value stands right behind its colon.
    gap = " " if start == end and text[start - 1 : start] == ":" else ""
    return text[:start] + gap + value + text[end:]


def _added(text: str, node: yaml.Node | None, key: str, value: str) -> str:
    """Return the text with a key at the begin of a mapping; at the end, for the outermost."""
    line = f"{key}: {value}"
    pairs = _pairs(node)
    if node is None or not pairs:
        if node is None or node.start_mark.index == 0:
            return f"{text.rstrip()}\n\n{line}\n".lstrip("\n")
        return _replaced(text, node, f"{{{line}}}")
    assert isinstance(node, yaml.MappingNode)
    first = pairs[0][0].start_mark
    if node.flow_style:
        return text[: first.index] + f"{line}, " + text[first.index :]
    if first.column == 0:
        return f"{text.rstrip()}\n\n{line}\n"
    return text[: first.index] + f"{line}\n{' ' * first.column}" + text[first.index :]


def _nested(path: Sequence[str], value: str) -> str:
    """Return a value as it is written in the mappings under a path of keys."""
    for key in reversed(path):
        value = f"{{{key}: {value}}}"
    return value
