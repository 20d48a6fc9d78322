"""Takes what was said of one instant into what is known of the carriers."""

from __future__ import annotations

from collections.abc import Iterable

from msgspec.structs import replace

from schemas.messages import Closed, Input, Navigation, SourceInfo, SourceProperties, SourceReport

from .. import navigation, timeline
from ..navigation import pose_at, site, way_m
from ..quality import Tally
from ..state import CarrierState, Link, Monitor, State
from ..state.links import frames_without
from .coordinates import Observer, instants_ns, places
from .features import NOTHING_LEARNED
from .logs import NO_LOGS, Rules, with_report
from .news import NOTHING_TOLD, has_tracks, news
from .telling import run_dictionary


def take_part(state: State, closed: Closed) -> State:
    """Who takes part from this Closed on, and who no longer.

    A correction that is interrupted by a loss has to earn its state again.
    """
    carriers, links = dict(state.carriers), dict(state.links)
    known = {carrier.name for carrier in state.scenario.carriers}
    for name in sorted((known | set(state.timeline.boots)) - {state.own, *links}):
        links[name] = Link()
    for name in (*closed.joined, *closed.lost):
        before = carriers.get(name, CarrierState())
        carriers[name] = replace(before, lost=name in closed.lost)
    interrupted = set(links) if state.own in closed.lost else set(closed.lost) & set(links)
    for name in sorted(interrupted):
        links[name] = replace(links[name], monitor=Monitor(), own_news=False, other_news=False)
    window = {k: t for k, t in state.window.items() if _carrier_of(k) not in closed.lost}
    return replace(state, carriers=carriers, links=links, window=window)


def out_of_order(state: State, reports: Iterable[SourceReport]) -> list[SourceReport]:
    """New reports that are stamped before one that their source has sent earlier."""
    found, newest = [], dict[tuple[str, str], int]()
    for report in sorted(reports, key=lambda report: report.seq):
        carrier, key = state.carriers.get(report.carrier), (report.carrier, report.stream)
        boot = timeline.ordinal(state.timeline, report.carrier, report.boot)
        if carrier is not None and boot == carrier.boot:
            known = carrier.logs.get(report.stream, NO_LOGS)
            if report.seq > known.report_seq:
                newest.setdefault(key, known.report_t_ns)
        if report.t_ns < newest.get(key, report.t_ns):
            found.append(report)
        newest[key] = max(newest.get(key, report.t_ns), report.t_ns)
    return found


def absorb(state: State, message: Input, tally: Tally) -> State:
    """The state with one message taken in; what an earlier life of its carrier sent is late."""
    boot = timeline.ordinal(state.timeline, message.carrier, message.boot)
    carrier = state.carriers.get(message.carrier, CarrierState())
    if boot < carrier.boot:
        tally.late(message)
        return state
    if boot > carrier.boot:
        state = _begun_anew(state, message.carrier)
        carrier = CarrierState(boot=boot)
    if isinstance(message, SourceInfo):
        carrier = replace(carrier, sources={**carrier.sources, message.source: message.properties})
    elif isinstance(message, Navigation):
        known = navigation.with_message(carrier.navigation, message)
        carrier = replace(carrier, navigation=known)
    state = replace(state, carriers={**state.carriers, message.carrier: carrier})
    return _with_report(state, message, tally) if isinstance(message, SourceReport) else state


def _with_report(state: State, report: SourceReport, tally: Tally) -> State:
    carrier = state.carriers[report.carrier]
    if not carrier.navigation:
        tally.unplaced(report)
        return state
    properties = state.sources(report.carrier).get(report.stream, SourceProperties())
    ways = way_m(carrier.navigation, instants_ns(report))
    observer = Observer(
        site(pose_at(carrier.navigation, report.t_ns)),
        ways - way_m(carrier.navigation, report.t_ns),
    )
    settings = state.settings.logs
    found = places(report, properties, observer, settings.target_altitude_m)
    if has_tracks(report, properties):
        told = carrier.told.get(report.stream, NOTHING_TOLD)
        found, told = news(told, report, properties, found, ways)
        carrier = replace(carrier, told={**carrier.told, report.stream: told})
    before = carrier.logs.get(report.stream, NO_LOGS)
    key = f"{report.carrier}/{carrier.boot}/{report.stream}"
    learned = state.picture.learned.get(key, NOTHING_LEARNED)
    known = run_dictionary(state)
    rules = Rules(settings, state.settings.tracking, properties, known, learned)
    logs, absorbed = with_report(before, report, found, ways, rules)
    tally.fused(report, absorbed)
    carrier = replace(carrier, logs={**carrier.logs, report.stream: logs})
    if properties.coordinates != "bearing":
        carrier = replace(carrier, report_t_ns=max(carrier.report_t_ns, report.t_ns))
        window = {**state.window, f"{report.carrier}/{report.stream}": report.t_ns}
        state = replace(state, links=_with_news(state, report.carrier), window=window)
    return replace(state, carriers={**state.carriers, report.carrier: carrier})


def _with_news(state: State, carrier: str) -> dict[str, Link]:
    """The links that a report concerns: all of the own carrier's, or the one of another."""
    if carrier != state.own:
        return {**state.links, carrier: replace(state.links[carrier], other_news=True)}
    return {name: replace(link, own_news=True) for name, link in state.links.items()}


def _begun_anew(state: State, carrier: str) -> State:
    """A carrier's new life has a new frame: nothing learnt of the old one holds."""
    links = {
        name: Link() if carrier in (name, state.own) else link for name, link in state.links.items()
    }
    window = {key: t for key, t in state.window.items() if _carrier_of(key) != carrier}
    frames = None if carrier == state.own else frames_without(state.frames, carrier)
    rays = {key: kept for key, kept in state.rays.items() if _carrier_of(key) != carrier}
    return replace(state, links=links, window=window, frames=frames, rays=rays)


def _carrier_of(source: str) -> str:
    return source.partition("/")[0]
