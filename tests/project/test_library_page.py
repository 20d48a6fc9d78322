"""The page on the library tells the truth: each program runs and prints what stands below it."""

import re

import pytest

from tests.project.tree import ROOT

PAGE = (ROOT / "docs" / "library.md").read_text(encoding="utf-8")
PROGRAM = re.compile(r"^```python\n(.*?)^```\n\n^```text\n(.*?)^```", re.DOTALL | re.MULTILINE)
PAPERS = ("000", "001", "002", "tracking", "003", "004")
MOST_LINES = 15


@pytest.mark.parametrize(("code", "printed"), PROGRAM.findall(PAGE), ids=PAPERS)
def test_a_program_of_the_page_prints_what_stands_below_it(
    code: str, printed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    exec(compile(code, "docs/library.md", "exec"), {})
    assert capsys.readouterr().out == printed
    assert sum(bool(line.strip()) for line in code.splitlines()) <= MOST_LINES


def test_every_program_of_the_page_has_its_output() -> None:
    assert PAGE.count("```python") == len(PROGRAM.findall(PAGE)) == len(PAPERS)
