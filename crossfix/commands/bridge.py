"""`crossfix bridge`: real sources as carriers of a run, and a run as lines of JSON."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi, radians
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, Parameter

from crossfix.commands import ENDPOINT, Count, Name, Sigma, Timeout

if TYPE_CHECKING:
    from carriers.bridges.bridge import Station
    from carriers.bridges.feeds import Feed

HELP = """
Let real sources take part in a run as a carrier, or print a run as lines of JSON.

```
crossfix bridge jsonl --udp 127.0.0.1:8600 --as carrier=harbour,source=radar --run strait
crossfix bridge status harbour --run strait
```
"""

bridge = App(name="bridge", help=HELP, help_format="markdown")


@bridge.default
def _help() -> None:
    bridge.help_print([])


@Parameter(name="*")
@dataclass(frozen=True)
class FeedOptions:
    """Where the records come from; exactly one, standard input by default.

    Attributes:
        udp: listen here for datagrams, of one or more lines each (HOST:PORT).
        tcp: connect to here, and again whenever the connection dies (HOST:PORT).
        listen: let others connect to here, any number of them (HOST:PORT).
    """

    udp: str | None = None
    tcp: str | None = None
    listen: str | None = None


@Parameter(name="*")
@dataclass(frozen=True)
class StationOptions:
    """What is said of the carrier and its sources where the records do not say it.

    Attributes:
        position: where the carrier stands: latitude and longitude in degrees, and perhaps altitude
            in metres, such as 36.01,-5.6,20; without it the records must bring navigation.
        sigma_position: of that place, or of poses that bring no covariance, in metres.
        sigma_north: of the carrier's north, in degrees.
        kind: of the sources, such as radar, passive, ais.
        coordinates: of their logs, by default what the first ones show.
        period: seconds between two reports.
        sigma_bearing: of logs without a sigma of their own, in degrees.
        sigma_range: the same, in metres.
        sigma_xy: the same of cartesian and geodetic logs, per axis in metres.
        stamp: `line` takes the time of a record where it has one; `arrival` takes the time of the
            run at which it came, for records of another clock.
        use_corrections: say everything in the frame that the fusion centre has found to be true.
    """

    position: str | None = None
    sigma_position: Sigma = 100.0
    sigma_north: Sigma = 1.0
    kind: Name = "radar"
    coordinates: Literal["bearing_range", "bearing", "cartesian", "geodetic"] | None = None
    period: Timeout = 1.0
    sigma_bearing: Sigma | None = None
    sigma_range: Sigma | None = None
    sigma_xy: Sigma | None = None
    stamp: Literal["line", "arrival"] = "line"
    use_corrections: Annotated[bool, Parameter(negative="")] = False


@Parameter(name="*")
@dataclass(frozen=True)
class RunOptions:
    """Where a bridge takes part.

    Attributes:
        names: of the carrier, and of the source of reports that name none.
        run: name of the run.
        connect: endpoint of the hub.
        start_timeout: seconds to wait for the hub and the run.
        dry_run: print what would be published and need no run; exit code 1 if a line is refused.
    """

    names: Annotated[str, Parameter(name="--as")] = "carrier=jsonl,source=jsonl"
    run: Name | None = None
    connect: str = ENDPOINT
    start_timeout: Timeout = 30.0
    dry_run: Annotated[bool, Parameter(negative="")] = False


@Parameter(name="*")
@dataclass(frozen=True)
class OutOptions:
    """The other way round.

    Attributes:
        out: print messages of the run instead, until it ends.
        topic: what to print, such as correction, report, quality; may be given again.
        count: print so many messages, then stop.
    """

    out: Annotated[bool, Parameter(negative="")] = False
    topic: Annotated[tuple[str, ...], Parameter(negative=())] = ()
    count: Count | None = None


STDIN, RECORDS_SAY = FeedOptions(), StationOptions()
HERE, INWARDS = RunOptions(), OutOptions()


@bridge.command
def jsonl(
    file: Annotated[str | None, Parameter(allow_leading_hyphen=True)] = None,
    /,
    *,
    feed: FeedOptions = STDIN,
    station: StationOptions = RECORDS_SAY,
    where: RunOptions = HERE,
    outwards: OutOptions = INWARDS,
) -> int:
    """Publish lines of JSON as one carrier, a report a line; or, with --out, print a run so.

    A line holds the fields of a SourceReport (docs/wire.md), angles in radians or under `_deg`
    names in degrees, one log as plain values or several as lists. `topic` makes it `navigation`,
    `source` or `ranging` instead. A line that is wrong is refused with the field to blame, and
    counted.

    ```
    mosquitto_sub -t radar/plots | crossfix bridge jsonl - --as carrier=harbour,source=radar
        --run strait --position 36.01,-5.6,20 --sigma-bearing 0.5 --sigma-range 40
    crossfix bridge jsonl plots.jsonl --dry-run
    crossfix bridge jsonl --out --run strait --topic correction
    ```

    Args:
        file: file to read to its end, or `-` for standard input.
    """
    from carriers.bridges import running
    from carriers.bridges.jsonl import JsonLines
    from carriers.bridges.listening import TOPICS

    _log_to_stderr()
    if outwards.out:
        topics = outwards.topic or TOPICS
        return running.print_run(where.connect, _needed(where.run), topics, outwards.count)
    names = {"carrier": "jsonl", "source": "jsonl"} | named(where.names)
    carrier, told = names["carrier"], station_of(station)
    decode = JsonLines(carrier, names["source"])
    run = where.run or "dry-run" if where.dry_run else _needed(where.run)
    opened = feed_of(file, feed)
    try:
        if where.dry_run:
            return running.show_feed(carrier, run, told, decode, opened)
        place = running.Place(run, carrier, where.connect, where.start_timeout)
        return running.publish_feed(place, told, decode, opened)
    finally:
        opened.close()


@bridge.command
def status(carrier: Name, /, *, run: Name, connect: str = ENDPOINT) -> None:
    """Ask a bridge what it has received, decoded, refused and published so far, as JSON.

    ```
    crossfix bridge status harbour --run strait
    ```

    Args:
        carrier: the name it takes part under.
        run: name of the run.
        connect: endpoint of the hub.
    """
    import json

    from carriers.bridges import running

    state = running.status(connect, run, carrier)
    print(json.dumps({"process": state.process, "step": state.step, **state.counters}))


def feed_of(file: str | None, options: FeedOptions) -> Feed:
    """The feed that is asked for.

    Raises:
        CrossfixError: two are asked for, or it cannot be opened.
    """
    from carriers.bridges.feeds import Connection, Connections, Datagrams, Pipe, endpoint
    from schemas.errors import CrossfixError

    if file and file.startswith("-") and file != "-":  # the lone hyphen lets them all through
        raise CrossfixError("no such option", got=file, expected="see --help")
    given = [text for text in (file, options.udp, options.tcp, options.listen) if text is not None]
    if len(given) > 1:
        raise CrossfixError(
            "records from two places", got=given, expected="a file, --udp, --tcp or --listen"
        )
    if options.udp:
        return Datagrams(*endpoint(options.udp))
    if options.tcp:
        return Connection(*endpoint(options.tcp))
    if options.listen:
        return Connections(*endpoint(options.listen))
    return Pipe(file or "-")


def station_of(options: StationOptions) -> Station:
    """What the options say of carrier and sources, checked.

    Raises:
        CrossfixError: a place or a number that is none.
    """
    import msgspec

    from carriers.bridges.bridge import Station
    from schemas.errors import CrossfixError
    from schemas.messages import Pose, SourceProperties

    place, north = options.sigma_position**2, radians(options.sigma_north) ** 2
    covariance = [place, 0.0, 0.0, place, 0.0, north]
    properties: dict[str, Any] = {
        "kind": options.kind,
        "period_s": options.period,
        "sigma_bearing_rad": options.sigma_bearing and radians(options.sigma_bearing),
        "sigma_range_m": options.sigma_range,
        "sigma_position_m": options.sigma_xy,
        "coordinates": options.coordinates or "bearing_range",
    }
    try:
        pose = msgspec.convert({**_position(options.position), "covariance": covariance}, Pose)
        return Station(
            pose=pose if options.position else None,
            covariance=covariance,
            properties=msgspec.convert(properties, SourceProperties),
            coordinates_known=options.coordinates is not None,
            stamp_arrivals=options.stamp == "arrival",
            use_corrections=options.use_corrections,
        )
    except msgspec.ValidationError as error:
        raise CrossfixError(str(error), where="of carrier and sources") from None


def named(text: str) -> dict[str, str]:
    """`carrier=NAME,source=NAME` as names.

    Raises:
        CrossfixError: something else.
    """
    from schemas.errors import CrossfixError
    from schemas.keys import require_id

    parts = dict(part.partition("=")[::2] for part in text.split(","))
    if set(parts) - {"carrier", "source"}:
        raise CrossfixError("--as", got=text, expected="carrier=NAME,source=NAME")
    return {name: require_id(value) for name, value in parts.items()}


def _position(text: str | None) -> dict[str, float]:
    """LAT,LON[,ALT] in degrees and metres as a pose; the null island where there is none."""
    from schemas.errors import CrossfixError

    try:
        latitude, longitude, *altitude = map(float, (text or "0,0").split(","))
        (altitude_m,) = altitude or (0.0,)
        if not (abs(latitude) <= 90 and abs(longitude) <= 360 and isfinite(altitude_m)):
            raise ValueError
    except ValueError:
        expected = "LAT,LON or LAT,LON,ALT in degrees and metres"
        raise CrossfixError("--position", got=text, expected=expected) from None
    return {
        "latitude_rad": latitude * pi / 180,
        "longitude_rad": longitude * pi / 180,
        "altitude_m": altitude_m,
    }


def _needed(run: str | None) -> str:
    from schemas.errors import CrossfixError
    from schemas.keys import require_id

    if run is None:
        raise CrossfixError("which run?", expected="--run NAME, or --dry-run to join none")
    return require_id(run)


def _log_to_stderr() -> None:
    import logging
    import sys

    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
