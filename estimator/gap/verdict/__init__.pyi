from .choosing import SURE as SURE
from .describing import Wanted as Wanted
from .judging import NOWHERE as NOWHERE
from .keeping import growth as growth, take_back as take_back, why_worse as why_worse
from .workflow import find_gap as find_gap
