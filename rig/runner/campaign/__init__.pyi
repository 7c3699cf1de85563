from .bench import Bench as Bench, plain_test as plain_test
from .campaign_run import bench_of as bench_of, run_campaign as run_campaign
from .compiled_pieces import Needs as Needs
from .compiling import (
    WITHOUT_TESTS as WITHOUT_TESTS,
    compile_for as compile_for,
    is_compiled as is_compiled,
)
from .injection import SHUT_S as SHUT_S
from .operator_requests import (
    LONGEST_TEXT as LONGEST_TEXT,
    Desk as Desk,
    RefusedError as RefusedError,
    Request as Request,
)
from .pacing import Pace as Pace
from .stopping import StopFlag as StopFlag, stop_on_signals as stop_on_signals
from .streamed import StreamedRun as StreamedRun
