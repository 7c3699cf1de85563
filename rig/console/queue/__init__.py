"""The queue of campaigns that are to run next: its file, and what starts them one after another.

Both the console and `rig queue` change the file. Only a console starts what is in it.
"""

from .queue_file import (
    FILE_NAME as FILE_NAME,
    Queued as Queued,
    QueueError as QueueError,
    QueueFile as QueueFile,
)
from .working_off import Queue as Queue
