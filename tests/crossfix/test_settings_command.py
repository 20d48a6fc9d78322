"""`crossfix settings`: every setting with what it is, or those of a part."""

from __future__ import annotations

import json

import pytest

from crossfix.__main__ import main
from fusion_center.settings import describe


def shown(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["settings", *arguments])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_all_are_listed_as_they_are_described(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = shown(capsys, "--json")
    assert code == 0
    assert [one["name"] for one in json.loads(out)] == [one.name for one in describe()]
    gate = next(one for one in json.loads(out) if one["name"] == "association.gate")
    assert gate.keys() == {"name", "default", "limits", "doc"}


def test_a_part_chooses_and_a_table_is_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, _ = shown(capsys, "monitor.")
    assert code == 0
    assert "monitor.apply_after" in out
    assert "association" not in out


def test_what_no_setting_has_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    code, out, err = shown(capsys, "zzz")
    assert code not in (0, None)
    assert out == ""
    assert "zzz" in err
