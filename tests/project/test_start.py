"""What a start costs: nobody imports at once what only some of their work needs."""

import subprocess
import sys

import pytest

LIST_MODULES = """
import pkgutil, sys
for name in {packages!r}:
    package = __import__(name)
    for module in pkgutil.walk_packages(package.__path__, name + "."):
        if not module.name.endswith("__main__"):
            __import__(module.name)
print(*sorted(sys.modules))
"""


def loaded(program: str) -> set[str]:
    """Modules that a fresh interpreter has loaded when `program` printed them last."""
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


@pytest.mark.parametrize("package", ["sim_world", "carriers"])
def test_world_and_carriers_never_load_scipy(package: str) -> None:
    modules = loaded(LIST_MODULES.format(packages=[package]))
    assert package in modules
    assert "scipy" not in modules


def test_nothing_of_ours_is_imported_before_an_interrupt_would_be_caught() -> None:
    modules = loaded("import sys, crossfix.__main__\nprint(*sorted(sys.modules))")
    assert modules.isdisjoint({"cyclopts", "rich", "msgspec", "crossfix.commands", "schemas"})


def test_help_loads_nothing_heavy() -> None:
    program = (
        "import sys, crossfix.__main__ as front\n"
        "try: front.main(['--help'])\n"
        "except SystemExit: print('\\n', *sorted(sys.modules))"
    )
    modules = loaded(program)
    assert "cyclopts" in modules
    assert modules.isdisjoint({"numpy", "scipy", "zenoh", "mcap", "msgspec", "bokeh"})
