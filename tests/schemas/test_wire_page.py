"""The page of the wire is current, whole, and its links lead somewhere."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from schemas import keys, wire_page
from schemas.fields import fields_of
from schemas.json_schema import MESSAGES


def test_it_is_current() -> None:
    assert wire_page.main(["--check"]) == 0


def test_a_stale_page_is_told_and_mended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(wire_page, "PAGE", tmp_path / "wire.md")
    assert wire_page.main(["--check"]) == 1
    assert "python -m schemas.wire_page" in capsys.readouterr().err
    assert wire_page.main([]) == 0
    assert wire_page.main(["--check"]) == 0


def test_every_topic_field_and_covariance_is_on_it() -> None:
    page = wire_page.page()
    for topic in keys.TOPICS:
        assert f"| `{topic.template}` | [{topic.message.__name__}](#" in page
    for message in MESSAGES:
        section = page.split(f"\n### {message.__name__}\n")[1].split("\n### ")[0]
        named = re.findall(r"^\| `(\w+)` ", section, re.MULTILINE)
        assert named == [field.name for field in fields_of(message)]
    assert all(f"| `{name}` |" in page for name in keys.COVARIANCES)


def test_links_within_it_lead_to_a_section_and_every_row_has_all_its_cells() -> None:
    page = wire_page.page()
    sections = {name.lower() for name in re.findall(r"^### (\w+)$", page, re.MULTILINE)}
    assert set(re.findall(r"\(#(\w+)\)", page)) <= sections
    for table in re.findall(r"(?:^\|.*\n)+", page, re.MULTILINE):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}) == 1
