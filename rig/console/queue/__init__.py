"""The queue of campaigns that are to run next: its file, and what starts them one after another.

Both the console and `rig queue` change the file. Only a console starts what is in it.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
