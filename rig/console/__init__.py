"""The console is the operator's web page, which shows a rig's live stream and sends commands.

It uses the stream and the configuration, but never the loop: what it shows came by Zenoh, and it
acts only by signed commands or by starting `rig run`. docs/decisions/0018 gives the reasons.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
