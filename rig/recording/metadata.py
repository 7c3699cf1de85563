"""Metadata and events as JSON text, as every file format keeps them."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from .errors import RecordingProblem
from .recording import Event


def metadata_texts(
    path: str, metadata: Mapping[str, Any]
) -> tuple[dict[str, str], list[RecordingProblem]]:
    """Return a JSON text for each key, and a problem for each value JSON does not have."""
    texts: dict[str, str] = {}
    problems = []
    limit = "JSON has texts, finite numbers, lists, objects, true, false and null"
    for key, value in metadata.items():
        try:
            texts[key] = json.dumps(value, allow_nan=False)
        except (TypeError, ValueError) as error:
            remedy = "convert the value before it is recorded"
            problems.append(
                RecordingProblem(path, None, f"metadata {key!r}", str(error), limit, remedy)
            )
    return texts, problems


def events_text(events: Sequence[Event]) -> str:
    """Return events as one JSON text."""
    return json.dumps([[event.time_s, event.kind, event.text] for event in events])


def events_from(text: str | bytes) -> list[Event]:
    """Return the events of `events_text`.

    Raises:
        ValueError, TypeError: the text is not such a text.
    """
    return [Event(float(time_s), str(kind), str(what)) for time_s, kind, what in json.loads(text)]
