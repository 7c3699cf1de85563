from .devices import CanDevices as CanDevices
