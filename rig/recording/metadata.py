"""Metadata and events are stored as JSON text in every file format."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from .errors import RecordingProblem
from .recording import Event


def metadata_texts(
    path: str, metadata: Mapping[str, Any]
) -> tuple[dict[str, str], list[RecordingProblem]]:
    """Return a JSON text for each key, and a problem for each value that JSON cannot hold."""
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
    """Return events as one JSON text: a list of [time_s, kind, text]."""
    return json.dumps([[event.time_s, event.kind, event.text] for event in events])


def events_from(text: str | bytes) -> list[Event]:
    """Return the events in a JSON text that `events_text` made.

    Raises:
        ValueError, TypeError: the text is not of this form.
    """
    return [Event(float(time_s), str(kind), str(what)) for time_s, kind, what in json.loads(text)]
