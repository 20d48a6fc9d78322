"""One tree of errors for everything a user or a stranger can get wrong."""


class CrossfixError(Exception):
    """Something outside the program is wrong: what, where, what was got and what was expected.

    A bug is never a CrossfixError; the command line prints one of these as a sentence and exits
    with `exit_code`, everything else dies with its traceback.
    """

    exit_code = 2

    def __init__(
        self, what: str, *, where: str = "", got: object = None, expected: str = ""
    ) -> None:
        self.what, self.where, self.got, self.expected = what, where, got, expected
        parts = [f"{where}: {what}" if where else what]
        if got is not None:
            parts.append(f"got {got!r}")
        if expected:
            parts.append(f"expected {expected}")
        super().__init__("; ".join(parts))


class WireError(CrossfixError):
    """A payload, key or query from the wire that does not hold what it should."""


class ScenarioError(CrossfixError):
    """A scenario file that cannot be run; `where` is file and key."""


class SettingsError(CrossfixError):
    """A fusion setting that does not exist or lies outside its limits."""


class RecordingError(CrossfixError):
    """A recording that cannot be read, or only in part."""


class BusError(CrossfixError):
    """The hub cannot be reached, a port is taken, a query found nobody."""


class LaunchError(CrossfixError):
    """A process of the run could not be started or did not become ready in time."""
