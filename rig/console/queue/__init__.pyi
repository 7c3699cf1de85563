from .queue_file import Queued as Queued, QueueError as QueueError, QueueFile as QueueFile
from .working_off import Queue as Queue
