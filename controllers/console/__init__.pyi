from .links import Partial as Partial, TextLine as TextLine
from .serve import (
    CONSOLE as CONSOLE,
    Dispatcher as Dispatcher,
    advance_time as advance_time,
    drop_remote as drop_remote,
    take_line as take_line,
)
from .session import (
    SavedSession as SavedSession,
    Session as Session,
    open_session as open_session,
    snapshot_session as snapshot_session,
)
