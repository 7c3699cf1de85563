"""The operator's web page: a rig's live stream shown, and its commands given, in a browser.

It knows the stream and the configuration, never the loop: what it shows came by Zenoh, and what it
asks for goes by signed commands or by starting `rig run`. Why it is built so: docs/decisions/0018.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
