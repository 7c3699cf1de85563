"""Rewrites recordings as MCAP tools of other people do."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import Writer


def rewrite(
    recording: bytes, target: Path, topics: Sequence[str] | None = None, **options: Any
) -> None:
    """Write the messages of a recording to a new MCAP file, without their sequence numbers.

    Args:
        recording: the bytes of the recording.
        target: the new file.
        topics: the topics that are kept; None for all.
        options: compression and chunks, as `mcap.writer.Writer` takes them.
    """
    with target.open("wb") as file:
        writer = Writer(file, **options)
        writer.start()
        ids: dict[int, int] = {}
        for schema, channel, message in make_reader(BytesIO(recording)).iter_messages(topics):
            assert schema is not None
            if channel.id not in ids:
                copied = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, copied, channel.metadata
                )
            writer.add_message(
                ids[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()
