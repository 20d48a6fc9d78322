"""The command line, `crossfix VERB`: each verb is a module of `crossfix.commands`."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

from cyclopts import App, CycloptsError

from crossfix import __version__
from schemas.bus.entry import pin_threads
from schemas.errors import CrossfixError

VERBS = (
    "run",
    "world",
    "carrier",
    "fusion",
    "hub",
    "info",
    "verify",
    "refuse",
    "diff",
    "recover",
    "cut",
    "merge",
    "cat",
    "record",
    "export",
    "replay",
    "tell",
    "peek",
    "bridge",
    "report",
    "check",
    "settings",
    "doctor",
)
"""Verb `x` is the function `x` in `crossfix/commands/x.py`, which imports what is heavy inside."""

BAD_USE = 2
"""Exit code of a command line that means nothing; a `CrossfixError` brings its own."""

HELP = """
Carriers that disagree about where they are and where north lies, and the centre that fuses them.

A first look at a recording, and the proof that it repeats itself:

```
crossfix info recordings/strait.mcap
crossfix verify recordings/strait.mcap --refuse
```

`crossfix VERB --help` explains a verb and shows an example.
"""


def new_app() -> App:
    """The command line with all its verbs."""
    app = App(
        name="crossfix",
        help=HELP,
        help_format="markdown",
        version=__version__,
        exit_on_error=False,
        print_error=False,
        result_action="return_value",
    )
    for verb in VERBS:
        app.command(getattr(import_module(f"crossfix.commands.{verb}"), verb), name=verb)
    return app


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one verb and exit: a user's error is one line, a bug keeps its traceback."""
    pin_threads()
    try:
        code = new_app()(arguments)
    except CycloptsError as error:
        _explain(f"{error} See `{_help_for(error)}`.")
        code = BAD_USE
    except CrossfixError as error:
        _explain(str(error))
        code = error.exit_code
    sys.exit(code)


def _help_for(error: CycloptsError) -> str:
    return " ".join(("crossfix", *(error.command_chain or ()), "--help"))


def _explain(error: str) -> None:
    from rich.console import Console
    from rich.text import Text

    line = Text.assemble(("error: ", "bold red"), error)
    Console(stderr=True, soft_wrap=True).print(line)


if __name__ == "__main__":
    main()
