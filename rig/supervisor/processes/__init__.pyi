from .child import (
    Child as Child,
    ChildError as ChildError,
    News as News,
    NoAnswerError as NoAnswerError,
)
from .driven import Driven as Driven
from .field import (
    FollowMoves as FollowMoves,
    MakeSafe as MakeSafe,
    OpenField as OpenField,
    WriteOutputs as WriteOutputs,
)
from .health import (
    STEPS as STEPS,
    loop_channel as loop_channel,
    stage_times as stage_times,
    trips_of as trips_of,
    trips_told as trips_told,
)
from .onlooker import Errand as Errand, Onlooker as Onlooker
from .recorder import (
    BeginRecording as BeginRecording,
    FinishRecording as FinishRecording,
    NoteInRecording as NoteInRecording,
)
from .safety_thread import (
    FIELD_WAIT_S as FIELD_WAIT_S,
    Parts as Parts,
    SafetyThread as SafetyThread,
)
from .streaming import RowFeed as RowFeed, Stream as Stream
