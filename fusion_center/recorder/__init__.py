"""Records everything a run says, without a hole, in a thread and on a session of its own."""

from .beginning import How, begin, record_run
from .rows import EVERYTHING, Wanted, require_wanted
from .thread import Recorder

__all__ = ["EVERYTHING", "How", "Recorder", "Wanted", "begin", "record_run", "require_wanted"]
