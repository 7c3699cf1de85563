from .address import AddressError as AddressError, address_of as address_of
from .launcher import offers_of as offers_of
from .running import serve as serve
from .server import Served as Served
from .visitors import console_token as console_token
