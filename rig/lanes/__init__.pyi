from .arithmetic import emit_function as emit_function
from .arrays import in_lanes as in_lanes
from .choosing import anywhere as anywhere, everywhere as everywhere, select as select
from .kinds import LANES as LANES, intrinsic as intrinsic, lanes as lanes
from .memory import (
    align_stack as align_stack,
    aligned as aligned,
    empty_lanes as empty_lanes,
    gather as gather,
    load as load,
    load_fields as load_fields,
    scatter as scatter,
    store as store,
)
from .normal import fill_normal as fill_normal, start_streams as start_streams
from .sines import sine_and_cosine as sine_and_cosine
