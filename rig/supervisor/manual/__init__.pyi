from .bounds import ManualError as ManualError
from .commands import HELP as HELP, parse as parse
from .session import Inbox as Inbox, Manual as Manual
