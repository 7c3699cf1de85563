from .address import AddressError as AddressError, address_of as address_of
from .launcher import Served as Served, offers_of as offers_of
from .queue import Queued as Queued, QueueError as QueueError, QueueFile as QueueFile
from .running import serve as serve
from .visitors import console_token as console_token
