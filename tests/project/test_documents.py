"""Documents tell the truth: links lead somewhere, commands and examples of the README run."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.crossfix.small_recording import record
from tests.project.pages import Place, at, blocks, commands
from tests.project.tree import ROOT, tracked

README = "README.md"
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
NOT_RUN = {
    "make demo": "it makes an environment of its own; .ci/run runs it",
    "make test": "it would run this test",
}
"""Commands of the README that are not run here, and why."""
TOGETHER = [
    "crossfix run scenarios/strait.toml --rate 2",
    "python examples/external_publisher.py --run strait",
    "crossfix check --run strait --carrier visitor",
    "crossfix peek 'correction/**' --run strait",
    "crossfix hub --listen tcp/127.0.0.1:7447",
    "crossfix hub --listen tcp/0.0.0.0:7447",
    "crossfix world scenarios/strait.toml --connect tcp/192.0.2.7:7447",
    "crossfix carrier levante --run strait --connect tcp/192.0.2.7:7447",
    "crossfix fusion --run strait --output recordings/spread.mcap --connect tcp/192.0.2.7:7447",
]
"""Commands that need each other: `tests/examples/test_together.py` runs them."""
RUN = [c for c in commands(README) if c not in NOT_RUN and c not in TOGETHER]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    place = Place(tmp_path_factory.mktemp("readme"), duration_s=20)
    record(place.folder / "recordings" / "strait.mcap")
    return place


@pytest.mark.parametrize("command", RUN)
def test_every_command_of_the_readme_runs(command: str, place: Place, hub: str) -> None:
    done = place.run(at(hub, command))
    assert done.returncode == 0, done.stdout + done.stderr


def test_commands_that_are_run_elsewhere_stand_in_the_readme() -> None:
    assert {*NOT_RUN, *TOGETHER} <= set(commands(README))
    assert RUN


@pytest.mark.parametrize("code", blocks(README, "python"))
def test_every_example_of_the_readme_runs(code: str, place: Place) -> None:
    (place.folder / "example.py").write_text(code)
    done = place.run("python example.py")
    assert done.returncode == 0, done.stderr
    assert done.stdout


def test_links_between_documents_lead_somewhere() -> None:
    dead = [
        f"{path.relative_to(ROOT)}: {target}"
        for path in tracked(".md")
        for target in relative_links(path)
        if not (path.parent / target).exists()
    ]
    assert dead == []


def test_every_make_target_in_the_documents_exists() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    named = {
        name
        for path in tracked(".md")
        for code in CODE.findall(path.read_text(encoding="utf-8"))
        for name in re.findall(r"\bmake ([a-z][a-z-]*)", code)
    }
    assert {"demo", "test"} <= named
    assert named <= targets


def relative_links(path: Path) -> Iterator[str]:
    """Targets of the links within the project; code is no link."""
    for target in LINK.findall(CODE.sub("", path.read_text(encoding="utf-8"))):
        if not re.match(r"[a-z]+:|#", target):
            yield target.partition("#")[0]


def test_every_package_has_its_place_in_the_architecture() -> None:
    """By its name, there or on the page of the library that it refers to."""
    told = "".join(
        (ROOT / page).read_text("utf-8") for page in ("ARCHITECTURE.md", "docs/library.md")
    )
    homes = ("schemas", "estimation", "sim_world", "carriers", "fusion_center", "crossfix")
    folders = {path.parent for home in homes for path in (ROOT / home).rglob("__init__.py")}
    assert [f.name for f in sorted(folders) if not re.search(rf"\b{f.name}\b", told)] == []
