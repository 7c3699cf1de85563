from .devices import CanDevices as CanDevices, ValvePath as ValvePath
