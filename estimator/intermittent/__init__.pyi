from .openings import compile_openings as compile_openings
from .records import Company as Company, Episode as Episode, Intermittent as Intermittent
from .return_test import ReturnTest as ReturnTest
