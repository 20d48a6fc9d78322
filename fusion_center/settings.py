"""Everything that can be tuned in the fusion, in one tree: `[fusion]` of a scenario file.

Each setting has its doc, its default and its limits in its declaration; `describe` lists them,
`settings_from` reads a table, `with_setting` changes one by its dotted name. All three refuse what
does not exist or lies outside its limits, and name what comes nearest.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin, get_type_hints

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace

from schemas.errors import SettingsError


def _positive(doc: str, most: float) -> Meta:
    return Meta(gt=0, le=most, description=doc)


class LogSettings(Struct, frozen=True, kw_only=True):
    """How target logs are kept and brought to one instant."""

    max_age_s: Annotated[
        float,
        _positive("a log is extrapolated no further, and over no longer gap, than this", 3600.0),
    ] = 15.0
    single_max_age_s: Annotated[
        float,
        _positive("the same for a log without a predecessor: its velocity is unknown", 3600.0),
    ] = 1.0
    sigma_velocity_mps: Annotated[
        float, _positive("per axis, of a target of which there is only one log", 1e5)
    ] = 30.0
    max_speed_mps: Annotated[
        float, _positive("what has moved faster is another target under the same name", 1e5)
    ] = 1000.0
    sigma_acceleration_mps2: Annotated[
        float,
        Meta(ge=0, le=1e4, description="per axis: what a line through two logs leaves out"),
    ] = 0.3
    target_altitude_m: Annotated[
        float,
        Meta(ge=-1e3, le=1e5, description="above the ellipsoid, of logs that say nothing of it"),
    ] = 0.0
    max_per_source: Annotated[
        int, Meta(ge=1, le=10**6, description="targets remembered of one source, newest first")
    ] = 5000


class TrackingSettings(Struct, frozen=True, kw_only=True):
    """How the plots of one source are made tracks in its own frame."""

    process_noise_m2ps3: Annotated[
        float,
        Meta(gt=0, le=1e6, description="spectral density of the targets' manoeuvres, per axis"),
    ] = 0.5
    gate: Annotated[
        float, _positive("chi2 of 2 dof within which a plot may be of a track", 1e4)
    ] = 16.0
    clutter_per_scan: Annotated[
        float, _positive("false or new plots expected of a source beyond what it declares", 1e6)
    ] = 0.5
    birth: Annotated[
        float, Meta(gt=0, lt=1, description="probability that a plot of no track is of a target")
    ] = 0.2
    confirm: Annotated[
        float, Meta(gt=0, lt=1, description="probability from which a track is taken for a target")
    ] = 0.95
    give_up: Annotated[
        float, Meta(gt=0, lt=1, description="probability below which a track is forgotten")
    ] = 0.02
    confirm_after: Annotated[
        int, Meta(ge=1, le=10**4, description="plots of a nameless track before it is confirmed")
    ] = 3


class PictureSettings(Struct, frozen=True, kw_only=True):
    """How the reports of all carriers are made one picture."""

    enabled: Annotated[bool, Meta(description="whether there is a picture at all")] = True
    half_width_m: Annotated[
        float, _positive("of the square about the origin in which tracks may begin", 1e7)
    ] = 200_000.0
    gate: Annotated[
        float, _positive("Mahalanobis distance squared beyond which a plot is of no track", 1e4)
    ] = 20.0
    steady_m2ps3: Annotated[
        float, _positive("spectral density of the acceleration of a target on rails or moored", 1e6)
    ] = 1e-4
    quiet_m2ps3: Annotated[float, _positive("the same of one that goes straight", 1e6)] = 0.02
    turning_rad2ps: Annotated[
        float, _positive("spectral density of the turn rate of a target that turns", 1e3)
    ] = 0.005
    hastening_ps: Annotated[
        float, _positive("the same of the relative change of its speed", 1e3)
    ] = 0.001
    manoeuvring_m2ps3: Annotated[
        float, _positive("of the acceleration of what manoeuvres hard", 1e6)
    ] = 20.0
    sigma_speed_mps: Annotated[float, _positive("per axis, of a target just found", 1e5)] = 50.0
    lifetime_s: Annotated[
        float, _positive("mean time from a target's appearing to its vanishing", 1e9)
    ] = 3600.0
    confirmed: Annotated[
        float, Meta(gt=0, lt=1, description="existence from which a track is shown")
    ] = 0.5
    class_trust: Annotated[
        float, Meta(gt=0, lt=1, description="share of the classes told that mean the target at all")
    ] = 0.8


class FeatureSettings(Struct, frozen=True, kw_only=True):
    """How features of targets, such as a length, help to tell them apart."""

    enabled: Annotated[bool, Meta(description="whether features count in any association")] = True
    learn: Annotated[
        bool, Meta(description="whether their sigmas and confusions are learned, not just declared")
    ] = True
    most_pairs: Annotated[
        float, _positive("confident pairs that a learned sigma or confusion remembers", 1e6)
    ] = 1000.0


class PassiveSettings(Struct, frozen=True, kw_only=True):
    """How the bearings of passive sources are made solutions."""

    enabled: Annotated[bool, Meta(description="whether bearings alone are solved at all")] = True
    memory_s: Annotated[
        float, _positive("bearings older than this before the newest are forgotten", 1e6)
    ] = 1800.0
    most_bearings: Annotated[
        int, Meta(ge=3, le=10**4, description="of one target, the newest of them")
    ] = 120
    least_bearings: Annotated[
        int, Meta(ge=3, le=10**4, description="before a target is solved for the first time")
    ] = 4
    most_targets: Annotated[
        int, Meta(ge=1, le=10**5, description="whose bearings are kept, those seen last")
    ] = 300
    solve_every_s: Annotated[
        float, Meta(ge=0, le=1e6, description="least time between two solutions of one target")
    ] = 5.0
    frames_memory_s: Annotated[
        float, _positive("of bearings from which the frame of a passive carrier is found", 1e5)
    ] = 600.0
    frames_every_s: Annotated[
        float, Meta(ge=0, le=1e6, description="least time between two attempts at such a frame")
    ] = 15.0
    frames_most_targets: Annotated[
        int, Meta(ge=1, le=1000, description="that take part in one, those seen most often")
    ] = 20
    shown_s: Annotated[
        float, _positive("for which a solution is told after its last bearing", 1e6)
    ] = 60.0


class AlignmentSettings(Struct, frozen=True, kw_only=True):
    """How carriers that range to each other and to beacons are aligned, in one joint state."""

    enabled: Annotated[bool, Meta(description="whether ranges are used at all")] = True
    most_beacons: Annotated[
        int, Meta(ge=1, le=200, description="that are used, the first that are declared")
    ] = 32
    most_targets: Annotated[
        int, Meta(ge=0, le=1000, description="in the joint state, the first seen by two carriers")
    ] = 40
    target_memory_s: Annotated[
        float, _positive("for which a target stays in the joint state unseen", 3600.0)
    ] = 60.0
    diagnose_every_s: Annotated[
        float, Meta(ge=0, le=1e6, description="least time between two looks at what is observable")
    ] = 5.0


class NavigationSettings(Struct, frozen=True, kw_only=True):
    """How carriers are carried on between and after their navigation messages."""

    max_age_s: Annotated[
        float, _positive("older navigation of a carrier places it no longer", 3600.0)
    ] = 30.0
    sigma_speed_mps: Annotated[
        float, _positive("of a carrier that is carried on, where it states none itself", 1e3)
    ] = 0.5


class AssociationSettings(Struct, frozen=True, kw_only=True):
    """Which logs of two carriers are taken for one target."""

    gate: Annotated[
        float, _positive("chi2 of 2 dof within which coordinates may pair; 9.21 is 99 %", 1e4)
    ] = 9.21
    max_orders: Annotated[
        int, Meta(ge=0, le=10**5, description="operator's bound or forbidden pairs remembered")
    ] = 1000


class RegistrationSettings(Struct, frozen=True, kw_only=True):
    """How the frames of other carriers are estimated."""

    method: Annotated[
        Literal["joint", "closed_form", "adjustment"],
        Meta(
            description="all frames followed together over time; or, instant by instant and pair "
            "by pair, paper 000 as published or the exact iterated adjustment in own axes"
        ),
    ] = "joint"
    trust: Annotated[
        float,
        Meta(gt=0.5, lt=1, description="probability of an association above which it is used"),
    ] = 0.99
    most_tracks: Annotated[
        int, Meta(ge=2, le=5000, description="surest tracks of a carrier that are searched")
    ] = 150
    drift_memory_s: Annotated[
        float, _positive("in which a current or an error of the log becomes another one", 1e9)
    ] = 3600.0
    drift_m_per_root_s: Annotated[
        float, Meta(ge=0, le=1e4, description="random walk of a place beside that, per axis")
    ] = 0.05
    drift_rad_per_root_s: Annotated[
        float, Meta(ge=0, le=1, description="random walk of a north beyond what is stated")
    ] = 1e-5
    verify_every: Annotated[
        int, Meta(ge=1, le=10**6, description="report events between two searches from the start")
    ] = 30


class MonitorSettings(Struct, frozen=True, kw_only=True):
    """When a correction is applied, and when no longer; all counted in report events."""

    apply_after: Annotated[
        int, Meta(ge=1, le=10**4, description="good estimates in a row before it is applied")
    ] = 3
    leave_after: Annotated[
        int, Meta(ge=1, le=10**4, description="undetermined estimates in a row before it is left")
    ] = 3
    suspend_after: Annotated[
        int, Meta(ge=1, le=10**4, description="excessive chi2 in a row before it is suspended")
    ] = 2
    chi2_false_alarm: Annotated[
        float, Meta(gt=0, lt=1, description="probability that a right estimate's chi2 is excessive")
    ] = 1e-3


class Settings(Struct, frozen=True, kw_only=True):
    """The settings of the fusion centre."""

    own: Annotated[
        str,
        Meta(
            pattern=r"^[a-z0-9_-]{0,32}$(?!\n)",
            description="the carrier whose frame is the picture's; empty = the first declared",
        ),
    ] = ""
    logs: LogSettings = LogSettings()
    tracking: TrackingSettings = TrackingSettings()
    navigation: NavigationSettings = NavigationSettings()
    association: AssociationSettings = AssociationSettings()
    registration: RegistrationSettings = RegistrationSettings()
    monitor: MonitorSettings = MonitorSettings()
    picture: PictureSettings = PictureSettings()
    features: FeatureSettings = FeatureSettings()
    passive: PassiveSettings = PassiveSettings()
    alignment: AlignmentSettings = AlignmentSettings()


class Description(NamedTuple):
    """One setting for people: dotted name, default, limits in words, doc."""

    name: str
    default: bool | int | float | str
    limits: str
    doc: str


def describe() -> list[Description]:
    """Every setting there is, in the order of declaration."""
    return [
        Description(name, _value_of(Settings(), name), _limits(kind), _meta(kind).description or "")
        for name, kind in _kinds(Settings)
    ]


def settings_from(table: Mapping[str, Any]) -> Settings:
    """The settings a `[fusion]` table asks for; what it leaves out has its default.

    Raises:
        SettingsError: an unknown name or a value outside its limits; `where` is the dotted name.
    """
    settings = Settings()
    for name, value in _leaves(table):
        settings = with_setting(settings, name, value)
    return settings


def with_setting(settings: Settings, name: str, value: object) -> Settings:
    """The settings with one changed, by its dotted name such as `association.gate`.

    Raises:
        SettingsError: no such setting, or the value has the wrong type or lies outside its limits.
    """
    kinds = dict(_kinds(Settings))
    if name not in kinds:
        nearest = get_close_matches(name, kinds, n=1, cutoff=0.0)[0]
        raise SettingsError("no such setting", where=name, got=value, expected=f"such as {nearest}")
    try:
        checked = msgspec.convert(value, kinds[name])
    except msgspec.ValidationError:
        limits = _limits(kinds[name])
        raise SettingsError("no such value", where=name, got=value, expected=limits) from None
    group, _, field = name.rpartition(".")
    if not group:
        return replace(settings, **{field: checked})
    return replace(settings, **{group: replace(getattr(settings, group), **{field: checked})})


def _kinds(tree: type[Struct], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted name and annotated type of every leaf."""
    for field, kind in get_type_hints(tree, include_extras=True).items():
        if isinstance(kind, type) and issubclass(kind, Struct):
            yield from _kinds(kind, f"{field}.")
        else:
            yield prefix + field, kind


def _leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _value_of(settings: Settings, name: str) -> Any:
    group, _, field = name.rpartition(".")
    return getattr(getattr(settings, group) if group else settings, field)


def _meta(kind: Any) -> Meta:
    meta: Meta = get_args(kind)[1]
    return meta


def _limits(kind: Any) -> str:
    """Type and limits in words: `float > 0 and <= 10000`."""
    base, meta = get_args(kind)
    if get_origin(base) is Literal:
        return " or ".join(get_args(base))
    if meta.pattern is not None:
        return "an id ([a-z0-9_-], up to 32) or nothing"
    bounds = [
        f"{sign} {bound:g}"
        for sign, bound in ((">", meta.gt), (">=", meta.ge), ("<", meta.lt), ("<=", meta.le))
        if bound is not None
    ]
    return f"{base.__name__} {' and '.join(bounds)}"
