"""crossfix: carriers that disagree about their frames, and the centre that fuses their views.

What is listed here is the public interface; each name is imported from its home when it is first
used, so `import crossfix` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from crossfix.analysis import Recording, open_recording
    from crossfix.columns import Columns
    from crossfix.cutting import cut
    from crossfix.differences import diff
    from crossfix.refusing import refuse
    from fusion_center.fuse import fuse
    from fusion_center.settings import Settings
    from schemas.errors import CrossfixError
    from sim_world.scenario import load_scenario

__version__ = "0.1.0"

__all__ = [
    "Columns",
    "CrossfixError",
    "Recording",
    "Settings",
    "__version__",
    "cut",
    "diff",
    "fuse",
    "load_scenario",
    "open_recording",
    "refuse",
]

_HOMES = {
    "Columns": "crossfix.columns",
    "Recording": "crossfix.analysis",
    "cut": "crossfix.cutting",
    "diff": "crossfix.differences",
    "refuse": "crossfix.refusing",
    "CrossfixError": "schemas.errors",
    "Settings": "fusion_center.settings",
    "fuse": "fusion_center.fuse",
    "load_scenario": "sim_world.scenario",
    "open_recording": "crossfix.analysis",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
