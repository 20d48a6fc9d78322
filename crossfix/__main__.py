"""The command line, `crossfix VERB`: each verb is a module of `crossfix.commands`."""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, NoReturn

from crossfix import __version__

if TYPE_CHECKING:
    from cyclopts import App, CycloptsError

GROUPS = {
    "Run a scenario": ("run", "doctor", "settings"),
    "A run on several machines": ("hub", "world", "carrier", "fusion", "record", "tell"),
    "Take part in a run": ("bridge", "check", "peek"),
    "Look at a recording": ("info", "report", "verify", "diff", "cat", "export"),
    "Make of a recording": ("refuse", "replay", "cut", "merge", "recover"),
}
"""The verbs by what they are for, as `crossfix --help` shows them."""

VERBS = tuple(verb for verbs in GROUPS.values() for verb in verbs)
"""Verb `x` is the function `x` in `crossfix/commands/x.py`, which imports what is heavy inside."""

BAD_USE = 2
"""Exit code of a command line that means nothing; a `CrossfixError` brings its own."""

HELP = """
Carriers that disagree about where they are and where north lies, and the centre that fuses them.

A run, a page that shows it, and the proof that it repeats itself:

```
crossfix run scenarios/strait.toml --report
crossfix info recordings/strait.mcap
crossfix verify recordings/strait.mcap --refuse
```

`crossfix VERB --help` explains a verb and shows an example.
"""


def new_app() -> App:
    """The command line with all its verbs."""
    from cyclopts import App, Group

    app = App(
        name="crossfix",
        help=HELP,
        help_format="markdown",
        version=__version__,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    for order, (title, verbs) in enumerate(GROUPS.items()):
        group = Group(title, sort_key=order)
        for verb in verbs:
            command = getattr(import_module(f"crossfix.commands.{verb}"), verb)
            app.command(command, name=verb)
            app[verb].group = group
    return app


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one verb and exit: a user's error is one line, a bug keeps its traceback."""
    try:
        code = _carried_out(arguments)
    except KeyboardInterrupt:  # also while half of it is not imported yet
        code = 128 + signal.SIGINT
    sys.exit(code)


def _carried_out(arguments: Sequence[str] | None) -> int | None:
    from cyclopts import CycloptsError

    from schemas.bus.entry import pin_threads
    from schemas.errors import CrossfixError

    pin_threads()
    try:
        code: int | None = new_app()(arguments)
    except CycloptsError as error:
        _explain(f"{_in_words(error)} See `{_help_for(error)}`.")
        return BAD_USE
    except CrossfixError as error:
        _explain(str(error))
        return error.exit_code
    return code


def _in_words(error: CycloptsError) -> str:
    from cyclopts import UnusedCliTokensError

    if isinstance(error, UnusedCliTokensError):
        return f"Nothing can be done with {' '.join(error.unused_tokens or ())}."
    return str(error)


def _help_for(error: CycloptsError) -> str:
    return " ".join(("crossfix", *(error.command_chain or ()), "--help"))


def _explain(error: str) -> None:
    from rich.console import Console
    from rich.text import Text

    line = Text.assemble(("error: ", "bold red"), error)
    Console(stderr=True, soft_wrap=True).print(line)


if __name__ == "__main__":
    main()
