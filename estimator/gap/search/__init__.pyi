from .added_variables import addition_variables as addition_variables
from .discovery import (
    DiscoveredModel as DiscoveredModel,
    Discovering as Discovering,
    Discovery as Discovery,
)
from .disturbances import (
    TIME as TIME,
    attribution as attribution,
    places_of as places_of,
    varying_of as varying_of,
)
from .drift import drifts as drifts
from .findings import (
    CHANCE as CHANCE,
    FORM as FORM,
    HELD_OUT as HELD_OUT,
    MATERIAL as MATERIAL,
    NORMAL_95 as NORMAL_95,
    SETTLED as SETTLED,
    Alternative as Alternative,
    Found as Found,
    Named as Named,
    deviate as deviate,
)
from .refits import Refits as Refits
from .search import Search as Search
from .signatures import (
    ENDLESS as ENDLESS,
    absorbed as absorbed,
    cosines as cosines,
    limits as limits,
)
from .standing_in import ADDED as ADDED
