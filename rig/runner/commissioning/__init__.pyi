from .commissioning import SKIPPABLE as SKIPPABLE, Commissioning as Commissioning, Seen as Seen
from .findings import (
    SCHEMA as SCHEMA,
    Changes as Changes,
    Finding as Finding,
    findings_figures as findings_figures,
)
from .operator import DeclinedError as DeclinedError, Operator as Operator, Yes as Yes
from .probing import NotFoundError as NotFoundError, Signs as Signs
from .rig_file import write_rig_file as write_rig_file
