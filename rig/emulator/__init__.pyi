from .addresses import endpoints_of as endpoints_of
from .application import Emulator as Emulator
from .plant import EmulatedPlant as EmulatedPlant
from .priority import raise_priority as raise_priority
from .record import Record as Record
from .script import ATTENTIVE as ATTENTIVE, Script as Script, read_script as read_script
