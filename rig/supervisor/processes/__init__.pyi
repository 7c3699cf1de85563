from .child import Child as Child, ChildError as ChildError, News as News
from .driven import Driven as Driven
from .field import (
    FollowMoves as FollowMoves,
    MakeSafe as MakeSafe,
    OpenField as OpenField,
    Safety as Safety,
    WriteOutputs as WriteOutputs,
)
from .onlooker import Onlooker as Onlooker
from .recorder import (
    BeginRecording as BeginRecording,
    FinishRecording as FinishRecording,
    NoteInRecording as NoteInRecording,
)
from .streaming import RowFeed as RowFeed, Stream as Stream
from .watch import Parts as Parts, Watch as Watch, trips_of as trips_of
