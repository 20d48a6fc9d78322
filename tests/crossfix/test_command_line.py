"""The frame of the command line: help that teaches, errors in one line, bugs with a traceback."""

import signal

import pytest

from crossfix import __version__
from crossfix.__main__ import BAD_USE, VERBS, main, new_app
from schemas.errors import CrossfixError
from tests.crossfix.conftest import Crossfix


def test_help_names_every_verb_and_what_it_does(crossfix: Crossfix) -> None:
    shown = crossfix("--help")
    assert shown.code == 0
    for verb in VERBS:
        summary = (new_app()[verb].help or "").splitlines()[0]
        assert summary.split(".")[0][:30] in shown.out


@pytest.mark.parametrize("verb", VERBS)
def test_help_of_every_verb_shows_an_example_of_it(verb: str, crossfix: Crossfix) -> None:
    shown = crossfix(verb, "--help")
    assert shown.code == 0
    assert f" crossfix {verb} " in shown.out.replace(f"Usage: crossfix {verb}", "")


@pytest.mark.parametrize("verb", VERBS)
def test_every_option_of_every_verb_is_explained(verb: str) -> None:
    for argument in new_app()[verb].assemble_argument_collection(parse_docstring=True):
        is_group = bool(argument.children)
        assert is_group or argument.parameter.help, f"{verb} {argument.name}"


def test_version(crossfix: Crossfix) -> None:
    assert crossfix("--version").out.strip() == __version__


@pytest.mark.parametrize(
    "line",
    [
        ["unheard-of"],
        ["hub", "--lisen", "x"],
        ["peek", "--count", "x"],
        ["cat", "x.mcap", "--keys", "corection/**"],
        ["report", "."],
    ],
)
def test_a_command_line_that_means_nothing_is_explained(
    line: list[str], crossfix: Crossfix
) -> None:
    shown = crossfix(*line)
    assert shown.code == BAD_USE
    assert len(shown.err.splitlines()) == 1
    assert shown.err.startswith("error: ")


def test_an_error_of_the_user_is_one_line_and_its_exit_code(
    crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    error = CrossfixError("no such thing", where="here.toml", got="[x]", expected="y" * 200)
    monkeypatch.setattr("schemas.bus.hub.run_hub", _raising(error))
    shown = crossfix("hub")
    assert shown.code == error.exit_code
    assert shown.err == f"error: {error}\n"


def test_an_interrupt_is_no_bug_however_early_it_comes(
    crossfix: Crossfix, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("crossfix.__main__.new_app", _raising(KeyboardInterrupt()))
    shown = crossfix("hub")
    assert shown.code == 128 + signal.SIGINT
    assert shown.err == ""


def test_a_bug_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("schemas.bus.hub.run_hub", _raising(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        main(["hub"])


def _raising(error: BaseException):
    def run(*_: object, **__: object) -> None:
        raise error

    return run
