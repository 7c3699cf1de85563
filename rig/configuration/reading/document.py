"""YAML is read here so that every value has the file, line and column that it came from."""

import errno
import hashlib
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import yaml

from rig.recording import read_bounded
from rig.reserves import SHORT, remedy_for

from .problems import Place, Problems

T = TypeVar("T")

LONGEST_VALUE = 60
"""Most characters of a value that a message shows."""
MAX_DEPTH = 32
"""Most levels of lists and mappings within one another; the shipped files have eight at most."""
MAX_VALUES = 200_000
"""Most values of a file, those that its aliases repeat included, which would otherwise let a short
file unfold without bound; the largest real files, of registers and tables, have some thousand."""
MAX_BYTES = 8_000_000
"""Size in bytes of the largest YAML file that is read; `MAX_VALUES` values do not need more."""
MAX_BYTES_OF_OTHERS = 256_000_000
"""Size in bytes of the largest other file that a configuration names, such as a setpoint's CSV: an
hour at 1 kHz has 3.6 million rows of two numbers with up to 20 digits each, 150 MB."""
LONGEST_NUMBER = 100
"""Most characters of a number: 64 binary digits with their prefix are 66. Python takes a time that
grows with the square of the length, and refuses to write out longer ones."""
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
_LOADER = yaml.CSafeLoader if yaml.__with_libyaml__ else yaml.SafeLoader
"""libyaml's reader, ten times as fast as the one in Python, which is used where PyYAML lacks it."""


@dataclass(frozen=True, slots=True)
class Located:
    """A YAML value with its place: a scalar, a list of `Located`, or a dict of name to `Located`.

    The place of a value in a mapping is that of its key, so that an editor jumps to the line to
    change. `name` is the name of the value in messages. `sources` are the files with which it was
    read, to whose problems its mistakes are added.
    """

    value: Any
    place: Place
    name: str
    sources: "Sources" = field(repr=False, compare=False)

    def items(self) -> Iterator[tuple[str, "Located"]]:
        """Iterate over keys and values of a mapping; there are none if this is no mapping."""
        if isinstance(self.value, dict):
            yield from self.value.items()

    def elements(self) -> list["Located"]:
        """Return the elements of a list; [] if this is no list."""
        return self.value if isinstance(self.value, list) else []

    def get(self, key: str) -> "Located | None":
        """Return the entry of a mapping; None if it is missing or empty, or this is no mapping."""
        entry = self.value.get(key) if isinstance(self.value, dict) else None
        return None if entry is None or entry.value is None else entry

    def find(self, *path: str | int) -> "Located":
        """Return the value at a path of keys and indices; if it ends early, the last one on it."""
        here = self
        for step in path:
            try:
                here = here.value[step]
            except (KeyError, IndexError, TypeError):
                break
        return here

    def with_value(self, value: Any) -> "Located":
        """Return a `Located` that has another value and the place, name and sources of this one."""
        return Located(value, self.place, self.name, self.sources)

    def completed_by(self, defaults: "Located | None") -> "Located":
        """Return this mapping, with entries of `defaults` for the keys that it does not have.

        If this is no mapping, it is returned as it is. Defaults that are None or no mapping add
        nothing.
        """
        if defaults is None or not isinstance(self.value, dict):
            return self
        return self.with_value({**dict(defaults.items()), **self.value})

    def path_to(self, reference: str) -> Path:
        """Return the path that a text in this file means.

        A relative path counts from the file's folder; "~" is the user's home. The path need not
        exist.
        """
        return self.place.path.parent / Path(reference).expanduser()

    @property
    def shown(self) -> str:
        """The value as text of at most `LONGEST_VALUE` characters, for a message."""
        if isinstance(self.value, dict):
            return self._shown_distribution() or "a mapping"
        if isinstance(self.value, list):
            text = f"[{', '.join(element.shown for element in self.value)}]"
            return text if len(text) <= LONGEST_VALUE else "a list"
        text = "nothing" if self.value is None else str(self.value)
        return text if len(text) <= LONGEST_VALUE else text[: LONGEST_VALUE - 3] + "..."

    def _shown_distribution(self) -> str:
        """Return a distribution such as {uniform: [1 s, 2 s]}, which is one value, as text.

        The text is empty for any other mapping, and where it would be too long.
        """
        if len(self.value) != 1:
            return ""
        ((key, numbers),) = self.items()
        text = f"{{{key}: {numbers.shown}}}"
        return text if isinstance(numbers.value, list) and len(text) <= LONGEST_VALUE else ""

    def refuse(
        self, limit: str, remedy: str = "", value: object = None, key: str = "", name: str = ""
    ) -> None:
        """Record a mistake of this value or, if `key` is given, of that entry of this mapping.

        The problem is placed at the entry, or at the mapping if it has no such entry.

        Args:
            limit: the rule that is broken, as in `Problem`.
            remedy: the remedy, as in `Problem`.
            value: what the message shows in place of the value in the file.
            key: key of the entry, which is its name in the message.
            name: another name for the message.
        """
        found = self.find(key) if key else self
        text = found.shown if value is None else value
        self.sources.problems.add(found.place, name or key or self.name, text, limit, remedy)

    def plain(self) -> Any:
        """Return the value as ordinary dicts, lists and scalars."""
        if isinstance(self.value, dict):
            return {key: item.plain() for key, item in self.value.items()}
        if isinstance(self.value, list):
            return [item.plain() for item in self.value]
        return self.value


@dataclass
class Sources:
    """The files that a configuration was read from, with their SHA-256, and their problems."""

    problems: Problems = field(default_factory=Problems)
    sha256: dict[Path, str] = field(default_factory=dict)

    def finished(self, found: T | None) -> T:
        """Return `found`, unless problems were recorded; it may be None only if there are some.

        Raises:
            ConfigError: lists all problems that were recorded, if there are any.
        """
        self.problems.raise_if_any()
        assert found is not None
        return found

    def read_bytes(
        self, path: Path, referrer: Located | None = None, most: int = MAX_BYTES_OF_OTHERS
    ) -> bytes | None:
        """Return a file's content and keep its hash in `sha256`; None if it cannot be read.

        A problem is added then. It is placed at `referrer`, the value that names the file, if there
        is one. A file with more than `most` bytes is not read.
        """
        named = referrer or Located(path, Place(path, 0, 0), "file", self)
        try:
            content = read_bounded(path, most)
        except (OSError, ValueError) as error:
            # Python raises ValueError for a path with a NUL or with a lone surrogate.
            reason = getattr(error, "strerror", None) or str(error)
            reason = reason[:1].lower() + reason[1:]
            remedy = "check the path"
            if getattr(error, "errno", None) == errno.EFBIG:
                remedy = "is it the right file?"
            elif isinstance(error, OSError) and error.errno in SHORT:
                remedy = remedy_for(error)
            named.refuse(f"cannot be read: {reason}", remedy, path)
            return None
        self.sha256[path] = hashlib.sha256(content).hexdigest()
        return content

    def read_yaml(self, path: Path | None, referrer: Located | None = None) -> Located | None:
        """Return the mapping in a YAML file; if the file holds none, add a problem, return None.

        Without a path, return None and add no problem. If the file cannot be read, the problem is
        placed at `referrer`, the value that names it. A file above `MAX_BYTES` or with wrong syntax
        counts as holding none. Of a repeated key the first value counts, and a problem is added.
        """
        content = self.read_bytes(path, referrer, MAX_BYTES) if path is not None else None
        if path is None or content is None:
            return None
        start = Located(None, Place(path, 1, 1), "file", self)
        loader = None
        try:
            _check_shape(content)
            loader = _LOADER(content)
            node = loader.get_single_node()
            if not isinstance(node, yaml.MappingNode):
                start.refuse("is not a mapping", "write `key: value` lines", "")
                return None
            return _Builder(path, loader, self).build(node, start.place, "file", 0)
        except (yaml.YAMLError, UnicodeError, RecursionError) as error:
            self._add_syntax_problem(path, error)
            return None
        finally:
            if loader is not None:
                loader.dispose()

    def _add_syntax_problem(self, path: Path, error: Exception) -> None:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        place = Place(path, mark.line + 1, mark.column + 1) if mark else Place(path, 1, 1)
        reason = getattr(error, "problem", None) or getattr(error, "reason", None) or str(error)
        self.problems.add(
            place, "YAML", "", f"cannot be parsed: {reason}", "correct the syntax; UTF-8, no tabs"
        )


def _check_shape(content: bytes) -> None:
    """Parse a file's content once, to refuse what is nested too deeply or too large.

    libyaml's reader makes nodes by calling itself, and would exhaust the stack of the process; a
    node takes some hundred times the memory of its text.

    Raises:
        yaml.YAMLError: the file is nested more deeply than `MAX_DEPTH`, has more values than
            `MAX_VALUES`, or its syntax is wrong.
    """
    depth = values = 0
    for event in yaml.parse(content, Loader=_LOADER):
        if isinstance(event, yaml.NodeEvent):
            values += 1
            # Keys are counted here too, so that there may be twice as many.
            if values > 2 * MAX_VALUES:
                raise _shape_error(f"it has more than {MAX_VALUES} values", event)
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH + 1:
                raise _shape_error(f"it is nested too deeply (more than {MAX_DEPTH} levels)", event)
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _shape_error(problem: str, event: yaml.Event) -> yaml.MarkedYAMLError:
    mark: Any = event.start_mark  # libyaml has marks of its own, with the same attributes
    return yaml.MarkedYAMLError(problem=problem, problem_mark=mark)


@dataclass
class _Builder:
    """A builder of `Located` values from YAML nodes, which records bad keys and values."""

    path: Path
    loader: yaml.SafeLoader | yaml.CSafeLoader
    sources: Sources
    values: int = 0

    def _place(self, node: yaml.Node) -> Place:
        return Place(self.path, node.start_mark.line + 1, node.start_mark.column + 1)

    def build(self, node: yaml.Node, place: Place, name: str, depth: int) -> Located:
        self.values += 1
        if depth > MAX_DEPTH or self.values > MAX_VALUES:
            # Aliases are followed here only, and one may stand for a value that holds it.
            what = f"more than {MAX_VALUES} values"
            if depth > MAX_DEPTH:
                what = f"more than {MAX_DEPTH} levels"
            raise yaml.MarkedYAMLError(
                problem=f"{name} is nested too deeply, too large, or contains itself ({what})",
                problem_mark=node.start_mark,
            )
        value: Any
        if isinstance(node, yaml.MappingNode):
            value = self._mapping(node, depth)
        elif isinstance(node, yaml.SequenceNode):
            value = [
                self.build(element, self._place(element), f"{name}[{index}]", depth + 1)
                for index, element in enumerate(node.value)
            ]
        else:
            value = self._scalar(node, place, name)
        return Located(value, place, name, self.sources)

    def _mapping(self, node: yaml.MappingNode, depth: int) -> dict[str, Located]:
        entries: dict[str, Located] = {}
        for key_node, value_node in node.value:
            place = self._place(key_node)
            # Keys are names, so `no:` or `1:` stays text instead of becoming a boolean or a number.
            is_name = isinstance(key_node, yaml.ScalarNode)
            key = str(key_node.value) if is_name else "a list or mapping"
            if key in entries:
                limit = f"is given twice, first in line {entries[key].place.line}"
                self.sources.problems.add(place, key, "", limit, "keep one")
                continue
            entries[key] = self.build(value_node, place, key, depth + 1)
        return entries

    def _scalar(self, node: yaml.Node, place: Place, name: str) -> Any:
        if node.tag in _NUMBERS and len(node.value) > LONGEST_NUMBER:
            value = f"{node.value[: LONGEST_VALUE - 3]}..."
            limit = f"is a number of {len(node.value)} characters, above {LONGEST_NUMBER}"
            self.sources.problems.add(place, name, value, limit, "write fewer digits, or quote it")
            return None
        try:
            value = self.loader.construct_object(node)
        except (yaml.YAMLError, ValueError, OverflowError) as error:
            reason = getattr(error, "problem", None) or str(error)
            limit = f"cannot be read: {reason}"
            is_day = node.tag == "tag:yaml.org,2002:timestamp"
            remedy = "write a day of the calendar, such as 2026-03-31" if is_day else "quote it"
            value = str(node.value)
            shown = value if len(value) <= LONGEST_VALUE else f"{value[: LONGEST_VALUE - 3]}..."
            self.sources.problems.add(place, name, shown, limit, remedy)
            return None
        if isinstance(value, str) and "\0" in value:
            limit = r"has the character \x00, which no name and no path can have"
            remedy = "write a name of letters, digits and signs that a terminal can show"
            self.sources.problems.add(place, name, value[:LONGEST_VALUE], limit, remedy)
            return None
        return value if isinstance(value, Hashable) else str(node.value)
