from .bounds import LARGEST_JSON as LARGEST_JSON, read_bounded as read_bounded
from .errors import (
    MAX_PROBLEMS as MAX_PROBLEMS,
    RecordingError as RecordingError,
    RecordingProblem as RecordingProblem,
)
from .exporting import export as export
from .formats import (
    McapWriter as McapWriter,
    division_of as division_of,
    read_mcap as read_mcap,
    write_csv as write_csv,
)
from .reading import (
    EXTENSIONS as EXTENSIONS,
    Column as Column,
    read_measured as read_measured,
    read_recording as read_recording,
    read_sampling as read_sampling,
)
from .recording import REPLAY_CHANNELS as REPLAY_CHANNELS, Event as Event, Recording as Recording
from .recovery import RecoverySummary as RecoverySummary, recover as recover
from .sampling import Sampling as Sampling
from .targets import replace_text as replace_text, replacing as replacing
from .units import unit_of as unit_of
