from .bypass_io import BypassIo as BypassIo
from .io_device import IoDevice as IoDevice
from .io_node import IDENTITY as IDENTITY, IoNode as IoNode
from .mapped_device import MappedDevice as MappedDevice
from .server import ModbusServer as ModbusServer
