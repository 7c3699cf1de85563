from .answers import Answer as Answer
from .batches import Batches as Batches
from .client import StreamClient as StreamClient
from .commands import (
    LARGEST_COMMAND as LARGEST_COMMAND,
    LONGEST_NAME as LONGEST_NAME,
    Command as Command,
    Gate as Gate,
    KeyFileError as KeyFileError,
    Refused as Refused,
    asked_digest as asked_digest,
    credentials_of as credentials_of,
    fingerprint as fingerprint,
    gate_of as gate_of,
    own_key as own_key,
    state_folder as state_folder,
)
from .known import (
    Life as Life,
    Snapshot as Snapshot,
    UnknownRigError as UnknownRigError,
    Window as Window,
)
from .messages import (
    LASTING as LASTING,
    Samples as Samples,
    command_key as command_key,
    finite as finite,
    pack as pack,
    rig_id as rig_id,
)
from .sender import StreamSender as StreamSender
from .sessions import (
    StreamError as StreamError,
    UnreachableError as UnreachableError,
    check_files as check_files,
    publisher_session as publisher_session,
)
from .settings import (
    COMMANDS as COMMANDS,
    JOGGING as JOGGING,
    Access as Access,
    CommandName as CommandName,
    Endpoint as Endpoint,
    Login as Login,
    Mode as Mode,
    Operator as Operator,
    StreamSettings as StreamSettings,
    Tls as Tls,
)
from .voice import Voice as Voice, said as said, voice_of as voice_of
