"""Python, crossfix, and what it depends on: are the versions in the ranges it asks for?"""

from __future__ import annotations

import operator
import platform
import re
import tomllib
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import NamedTuple

import crossfix

from .finding import Finding

INSTALL = "python -m pip install --upgrade '{}'"
SHOWN_EXTRA = "view"
_COMPARE: Mapping[str, Callable[[tuple[int, ...], tuple[int, ...]], bool]] = {
    ">=": operator.ge,
    "<=": operator.le,
    "==": operator.eq,
    "!=": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
}


class Requirement(NamedTuple):
    """A package, the versions of it that are wanted, and the extra that wants it."""

    package: str
    versions: str
    extra: str = ""

    @property
    def text(self) -> str:
        """As pip takes it."""
        return f"{self.package}{self.versions}"


class Wanted(NamedTuple):
    """What crossfix asks for, and where that stands."""

    python: str
    requirements: tuple[Requirement, ...]
    source: str


def findings() -> Iterator[Finding]:
    """Python, crossfix, and every dependency."""
    wanted = wanted_here()
    yield python(platform.python_version(), wanted.python)
    yield Finding("crossfix", "ok", f"{crossfix.__version__}, {wanted.source}")
    for requirement in wanted.requirements:
        if requirement.extra in ("", SHOWN_EXTRA):
            yield dependency(requirement, _installed(requirement.package))


def python(found: str, wanted: str) -> Finding:
    """The interpreter."""
    if is_within(found, wanted):
        return Finding("python", "ok", f"{found}, {platform.machine()}")
    advice = f"use Python {wanted}: make PYTHON=python3.12, or a newer python -m venv"
    return Finding("python", "bad", found, advice)


def dependency(requirement: Requirement, found: str | None) -> Finding:
    """One package; those of an extra may be absent."""
    what = requirement.package
    if found is not None and is_within(found, requirement.versions):
        return Finding(what, "ok", found)
    if found is None and requirement.extra:
        wish = INSTALL.format(f"crossfix[{requirement.extra}]")
        return Finding(what, "ok", f"not installed; `crossfix report` needs it: {wish}")
    advice = INSTALL.format(requirement.text)
    said = "not installed" if found is None else f"{found}, not {requirement.versions}"
    return Finding(what, "bad", said, advice)


def wanted_here() -> Wanted:
    """Of the source tree if this runs from one, else of the installed package."""
    root = Path(crossfix.__file__).parents[1]
    pyproject = root / "pyproject.toml"
    if pyproject.is_file():
        project = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"]
        extra = project["optional-dependencies"].get(SHOWN_EXTRA, [])
        texts = [*project["dependencies"], *(f"{t}; extra == '{SHOWN_EXTRA}'" for t in extra)]
        return Wanted(project["requires-python"], _requirements(texts), f"source tree {root}")
    try:
        found = distribution("crossfix")
    except PackageNotFoundError:
        return Wanted("", (), f"copied to {root}: nothing says what it depends on")
    python_range = found.metadata["Requires-Python"] or ""
    return Wanted(python_range, _requirements(found.requires or ()), f"installed in {root}")


def is_within(found: str, wanted: str) -> bool:
    """Whether a version is in ranges such as `>=1.10,<2`."""
    for part in filter(None, wanted.replace(" ", "").split(",")):
        match = re.fullmatch(r"(>=|<=|==|!=|>|<)([\d.]+)", part)
        if match is None:
            return True  # a form we do not use ourselves: pip has judged it
        left, right = _release(found), _release(match[2])
        width = max(len(left), len(right))
        padded = (numbers + (0,) * (width - len(numbers)) for numbers in (left, right))
        if not _COMPARE[match[1]](*padded):
            return False
    return True


def _requirements(texts: Iterable[str]) -> tuple[Requirement, ...]:
    """From texts such as `bokeh>=3.6; extra == 'view'`."""
    found = []
    for text in texts:
        wish, _, marker = text.partition(";")
        match = re.fullmatch(r"([\w.-]+)(?:\[[^]]*\])?([^\[]*)", wish.strip())
        extra = re.search(r"extra\s*==\s*['\"]([\w-]+)", marker)
        if match is not None:
            found.append(Requirement(match[1], match[2].strip(), extra[1] if extra else ""))
    return tuple(found)


def _release(text: str) -> tuple[int, ...]:
    """The numbers a version begins with."""
    match = re.match(r"\d+(?:\.\d+)*", text)
    return tuple(map(int, match[0].split("."))) if match else ()


def _installed(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
