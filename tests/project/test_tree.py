"""Form of the tree: every module says what it is for, no machine's paths, no large files."""

import ast
import re
import tokenize
from pathlib import Path

from tests.project.tree import ROOT, tracked, tracked_files

MAX_BYTES = 1024 * 1024
BEFORE = {tokenize.ENCODING, tokenize.COMMENT, tokenize.NL}
MACHINE_PATHS = re.compile(
    "|".join((r"(?<!\w)/wo" r"rk/", r"(?<!\w)/ro" r"ot\b", r"/tmp/ve" r"nv"))
)


def test_every_module_begins_with_a_docstring_that_says_what_it_is() -> None:
    silent = [str(path.relative_to(ROOT)) for path in tracked(".py") if not _first_line(path)]
    assert silent == []


def test_no_file_names_a_path_of_the_machine_it_was_written_on() -> None:
    named = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in tracked_files()
        for number, line in enumerate(_lines(path), start=1)
        if MACHINE_PATHS.search(line)
    ]
    assert named == []


def test_no_tracked_file_is_larger_than_a_megabyte() -> None:
    large = [str(path) for path in tracked_files() if path.stat().st_size > MAX_BYTES]
    assert large == []


def test_no_package_gives_something_else_by_the_name_of_its_module() -> None:
    """Which of the two a program gets would hang on what was imported before."""
    packages = [path for path in tracked(".py") if path.name == "__init__.py"]
    assert [clash for path in packages for clash in _clashes(path)] == []


def _clashes(package: Path) -> list[str]:
    """Names that a package imports and that a module of it has too, but does not define."""
    within = {path.name.removesuffix(".py") for path in package.parent.iterdir()}
    imports = [
        (name.asname or name.name, node.module)
        for node in ast.parse(package.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom) and node.module
        for name in node.names
    ]
    return [
        f"{package.parent.relative_to(ROOT)}: {name} of {module}"
        for name, module in imports
        if name in within and module.rpartition(".")[2] != name
    ]


def _first_line(path: Path) -> str:
    """First line of the docstring; a docstring that begins with a blank line says nothing."""
    with path.open("rb") as file:
        for token in tokenize.tokenize(file.readline):  # the first statement is enough
            if token.type == tokenize.STRING:
                return str(ast.literal_eval(token.string)).split("\n", 1)[0].strip()
            if token.type not in BEFORE:
                return ""
    return ""


def _lines(path) -> list[str]:
    """Lines of a text file; none of a binary one."""
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError:
        return []
