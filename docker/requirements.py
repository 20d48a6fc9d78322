"""Prints what pyproject.toml depends on, one requirement a line: installed before the source is."""

import sys
import tomllib
from pathlib import Path


def main(path: str, *kinds: str) -> None:
    """Print the project's `dependencies`; with `build` those of its build as well."""
    project = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    requirements = project["project"]["dependencies"]
    if "build" in kinds:
        requirements += project["build-system"]["requires"]
    sys.stdout.writelines(f"{requirement}\n" for requirement in requirements)


if __name__ == "__main__":
    main(*sys.argv[1:])
