"""The types of what the entries of a campaign's journal say, which a reader checks first.

A line with a right checksum may still have been written by another program, or by hand.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from .archive import is_plain
from .journal import Entry


def _is_file_name(name: str) -> str:
    if not is_plain(name):
        raise ValueError("is no name of a file in the run's folder")
    return name


_FileName = Annotated[str, AfterValidator(_is_file_name)]
_Index = Annotated[int, Field(ge=0)]


class _Details(BaseModel):
    """The details of an entry; unknown ones may be those of a later version."""

    model_config = ConfigDict(strict=True, extra="ignore")


class _Begin(_Details):
    tests: list[str]
    campaign: str | None = None
    started: str | None = None
    fingerprint: dict[str, str] = {}
    versions: dict[str, str] | None = None
    given: dict[str, str | None] | None = None
    by: str | None = None


class _Resume(_Details):
    started: str | None = None
    versions_changed: str | None = None
    by: str | None = None


class _Phase(_Details):
    test: _Index
    phase: str
    kept: _FileName | None = None
    recording: _FileName | None = None


class _RecordOfOutcome(_Details):
    status: str
    recording: _FileName | None = None


class _Outcome(_Details):
    test: _Index
    outcome: _RecordOfOutcome


class _Operator(_Details):
    request: str
    who: str
    text: str | None = None
    test: _Index | None = None
    person: str | None = None
    seen: list[str] | None = None


class _Held(_Details):
    reasons: list[str]


class _Released(_Details):
    after_s: float


class _Refused(_Details):
    why: str


class _Told(_Details):
    what: str


class _Control(_Details):
    test: _Index
    at_s: float | None = None
    who: str
    what: str


class _End(_Details):
    reason: str | None = None
    exit_code: int | None = None


_TYPES: Final[Mapping[str, type[_Details]]] = {
    "begin": _Begin, "resume": _Resume, "phase": _Phase, "outcome": _Outcome,
    "operator": _Operator, "held": _Held, "released": _Released, "refused": _Refused,
    "driven": _Told, "limit": _Told, "control": _Control, "end": _End,
}  # fmt: skip
"""By kind of entry; an entry of another kind may be one of a later version."""


def check_types(entry: Entry) -> None:
    """Check that an entry says what one of its kind says.

    Raises:
        ValueError: a detail is missing, or of another type; the message names entry and detail.
    """
    kind: Any = entry.kind
    if not (isinstance(kind, str) and isinstance(entry.at, str)):
        raise ValueError(f"entry {entry.number}: kind and time are no texts")
    if kind not in _TYPES:
        return
    try:
        _TYPES[kind].model_validate(dict(entry.details))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ValueError(f"entry {entry.number}, {kind}: {where}: {first['msg']}") from None
