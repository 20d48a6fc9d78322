"""Carries out a run: launches its processes, watches them, and shows what the corrections did."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import FrameType

from schemas import keys
from schemas.bus.zenoh_bus import open_bus
from schemas.errors import CrossfixError, LaunchError
from schemas.messages import DeclaredScenario
from schemas.recording.parts import parts_of
from sim_world.scenario import load_scenario, parse_override

from .commands import ENDPOINT
from .commands.run import RunOptions
from .commands.verify import verify
from .launch import Child, Launch
from .new_file import new_recording, require_new
from .progress import Watcher, new_console
from .report import require_bokeh
from .table import show_results

HUB_S = 10.0
"""For a hub of our own to start in; one that runs already answers at once."""
ANSWER_S = 3.0


def carry_out(path: Path, options: RunOptions) -> int:
    """Run a scenario to its end; the exit code of the first process that failed.

    Raises:
        CrossfixError: the scenario, a setting or the hub is not what it should be; nothing has
            been started then.
    """
    declared = _checked(path, options)
    run = keys.require_id(options.name or declared.name)
    recording = options.output or new_recording(run)
    console = new_console()
    with (
        Watcher(run, declared.steps, console) as watcher,
        Launch(watcher.say) as launch,
    ):
        endpoint = options.connect or launch.start_hub()
        if options.connect:
            _refuse_if_alive(run, endpoint)
        elif endpoint != ENDPOINT:
            taken = f"{ENDPOINT} is taken: join this run with --connect {endpoint}"
            watcher.say("launch", taken)
        _on_interrupt(lambda: launch.interrupt(begun=watcher.steps_seen > 0))
        launch.start(processes(path, declared, run, recording, endpoint, options))
        with open_bus(endpoint, HUB_S) as bus:
            watcher.follow(bus)
            code = launch.watch(lambda: _follow(watcher, launch))
    if files := parts_of(recording) if recording.parent.is_dir() else []:
        console.print(f"recording: {', '.join(map(str, files))}", highlight=False)
        show_results(files[-1], as_json=options.json)
        if options.verify and not code:
            console.print("verify: fusing the recording again", highlight=False)
            code = verify(recording, refuse=True)
        if options.report:
            console.print(f"report: {_drawn(recording)}", highlight=False)
    return code


def _checked(path: Path, options: RunOptions) -> DeclaredScenario:
    """Everything a user can get wrong is found here, before a process is started."""
    from fusion_center import pipeline
    from fusion_center.settings import settings_from
    from sim_world.world import World

    overrides = dict(parse_override(text) for text in _overrides(options))
    scenario = load_scenario(path, overrides, options.data)
    pipeline.initial(scenario.declared, settings_from(scenario.declared.fusion))
    World(scenario)  # reads recorded tracks, if there are any
    options.files.require()
    if options.files.splits and (options.verify or options.report):
        raise CrossfixError("a recording in parts", expected="no --verify or --report with it")
    if options.report:
        require_bokeh()
    if options.output:
        require_new(options.output)
    return scenario.declared


def _drawn(recording: Path) -> Path:
    """The page of a recording, beside it."""
    from .report.writing import write_page

    page = recording.with_suffix(".html")
    write_page(recording, page)
    return page


def _overrides(options: RunOptions) -> list[str]:
    seed = [] if options.seed is None else [f"seed={options.seed}"]
    return [*options.overrides, *seed]


def processes(
    path: Path,
    declared: DeclaredScenario,
    run: str,
    recording: Path,
    endpoint: str,
    options: RunOptions,
) -> Sequence[Child]:
    """The processes of a run: world, fusion centre and one for each carrier."""
    wire = ["--connect", endpoint, "--run", run]
    timeout = ["--start-timeout", str(options.start_timeout)]
    timeout += ["--hub-timeout", str(options.hub_timeout)]
    world = ["sim_world", str(path), *wire, *timeout, "--rate", options.rate]
    world += ["--step-timeout", str(options.step_timeout)]
    for override in _overrides(options):
        world += ["--set", override]
    if options.data:
        world += ["--data", str(options.data)]
    fusion = ["fusion_center", *wire, *timeout, "--output", str(recording)]
    fusion += ["--max-loss", str(options.max_loss), *options.files.arguments()]
    delay = ["--delay", str(options.delay)] if options.delay else []
    carriers = [
        Child(carrier.name, ["carriers", carrier.name, *wire, *timeout, *delay])
        for carrier in declared.carriers
    ]
    return [Child("world", world, vital=True), Child("fusion", fusion, vital=True), *carriers]


def _follow(watcher: Watcher, launch: Launch) -> None:
    fused = watcher.steps_fused
    watcher.turn()
    if watcher.steps_fused > fused:
        launch.has_fused()


def _refuse_if_alive(run: str, endpoint: str) -> None:
    with open_bus(endpoint, ANSWER_S) as bus:
        tokens = bus.tokens(keys.every_alive(run))
    if tokens:
        names = sorted({keys.parse_alive(token)[1] for token in tokens})
        raise LaunchError(
            f"run `{run}` is alive on {endpoint}: {', '.join(names)}",
            expected="another --name, or the end of that run",
        )


def _on_interrupt(interrupt: Callable[[], None]) -> None:
    def handle(number: int, frame: FrameType | None) -> None:
        del number, frame
        interrupt()

    signal.signal(signal.SIGINT, handle)
    signal.signal(signal.SIGTERM, handle)
    sys.stdout.flush()
