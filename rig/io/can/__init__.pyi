from . import canopen as canopen, ds408 as ds408
from .ds408 import DriveState as DriveState, H as H
from .frames import FrameReader as FrameReader
from .libraries import cantools as cantools, python_can as python_can
from .link import CanOptions as CanOptions, open_bus as open_bus
from .pump import COMMAND as COMMAND, STATUS as STATUS, UNITS as UNITS, CanPump as CanPump
from .valve import CanValve as CanValve
