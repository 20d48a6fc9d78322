"""What the fusion centre concludes (role `output`): no wall clock, boot id or host in them."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct

from .inputs import Pose
from .values import (
    Angle,
    Count,
    Id,
    Latitude,
    Longitude,
    Metres,
    MetresPerSecond,
    Real,
    Share,
    Text,
    TimeNs,
    Triangle,
    require_covariance,
)

CorrectionState = Literal["off", "observing", "candidate", "applied", "suspended"]
LogId = Text
"""carrier/n/stream/seq/index, n the ordinal of the carrier's boot in Closed order."""


class Output(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The envelope of every output: it belongs to one Closed.

    Attributes:
        seq: counts from 1 per key.
        step, t_ns: those of the Closed.
    """

    centre: Id
    seq: Count
    step: Count
    t_ns: TimeNs


class Direction(Struct, frozen=True, kw_only=True):
    """One direction of a correction and how far the data inform it.

    Attributes:
        name: in words, such as `location along 040 deg`.
        ratio: posterior over prior sigma along it.
        status: determined (ratio < .5, or less is open than half a plot's sigma), weak (< .9) or
            undetermined.
    """

    name: Text
    ratio: Annotated[float, Meta(ge=0, le=1e6)]
    status: Literal["determined", "weak", "undetermined"]


class OwnAxes(Struct, frozen=True, kw_only=True):
    """A carrier's frame in the own carrier's sensor axes.

    Attributes:
        east_m, north_m: position of the other carrier (q).
        rotation_rad: what is added to the other's bearings to get own ones, beyond the known
            difference of the norths at the two reported places (D = c2 - c1).
        covariance: of (east, north, rotation), 3 x 3.
        reported_east_m, reported_north_m: the same position before the correction.
        drift_east_mps, drift_north_mps: how fast it moves beyond what both carriers reckon.
    """

    east_m: Metres
    north_m: Metres
    rotation_rad: Angle
    covariance: Triangle
    reported_east_m: Metres
    reported_north_m: Metres
    drift_east_mps: MetresPerSecond = 0.0
    drift_north_mps: MetresPerSecond = 0.0


class FixedAxes(Struct, frozen=True, kw_only=True):
    """The same correction in axes fixed to true north, as paper 000 writes it.

    Attributes:
        offset_east_m, offset_north_m: added to the reported offset of the other carrier.
        c1_rad, c2_rad: added to the bearings of the own and of the other carrier.
        covariance: of these four, 4 x 4.
    """

    offset_east_m: Metres
    offset_north_m: Metres
    c1_rad: Angle
    c2_rad: Angle
    covariance: Triangle


class SourceTerm(Struct, frozen=True, kw_only=True):
    """A systematic error of one source, what it measures less what is true.

    Attributes:
        name: range_bias_m, range_scale (a share of the range), azimuth_bias_rad, time_s.
    """

    source: Id
    name: Literal["range_bias_m", "range_scale", "azimuth_bias_rad", "time_s"]
    value: Real
    sigma: Real


class Feedback(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a carrier adds to its own so that its frame becomes that of the own carrier.

    Attributes:
        latitude_rad, longitude_rad: to its reported place, at `valid_t_ns` of the correction.
        latitude_rad_s, longitude_rad_s: by how much more for every second after that.
        north_rad: to its bearings and its heading.
        covariance: of (east, north, own north) [m, rad]: what is left of the error of its frame
            against that of the own carrier.
        wander_m2_s: by how much the variance of the place grows, per axis and second after that:
            by noise of both carriers' logs and compasses, and as its error goes with the drift's.
    """

    latitude_rad: Latitude
    longitude_rad: Longitude
    latitude_rad_s: Real = 0.0
    longitude_rad_s: Real = 0.0
    north_rad: Angle
    covariance: Triangle
    wander_m2_s: Annotated[float, Meta(ge=0, le=1e12)] = 0.0

    def __post_init__(self) -> None:
        require_covariance("covariance", self.covariance, (3,))


class Correction(Output, frozen=True, kw_only=True, omit_defaults=True):
    """Where another carrier's frame lies against the own one.

    Attributes:
        id: centre/carrier/step; Navigation names it when applied.
        state: off | observing | candidate | applied | suspended.
        reason: why it is in that state, in words.
        method: the estimator that made it.
        valid_t_ns: the instant the frame is estimated for.
        since_t_ns: when it was found, to be followed from then on; 0 = it is made anew each time.
        valid_for_s: after which the doubt of its drift is as large as that of its place; 0 = not
            known.
        own_pose, other_pose: the reported poses it refers to.
        own_axes, fixed_axes: absent while nothing is known beyond the prior.
        directions: from the weakest to the strongest; weakest: the first of them as a sentence.
        pairs: associated pairs used; chi2 of their misclosures over `dof`.
        mode_probability: that the association behind it is the right one.
        terms: systematic errors of single sources.
        feedback: how to apply it; only while it is applied and every direction is determined.
    """

    carrier: Id
    id: Text
    state: CorrectionState
    reason: Text = ""
    method: Id = "closed_form"
    valid_t_ns: TimeNs = 0
    since_t_ns: TimeNs = 0
    valid_for_s: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    own_pose: Pose | None = None
    other_pose: Pose | None = None
    own_axes: OwnAxes | None = None
    fixed_axes: FixedAxes | None = None
    directions: list[Direction] = []
    weakest: Text = ""
    pairs: Count = 0
    chi2: Annotated[float, Meta(ge=0, le=1e18)] = 0.0
    dof: Count = 0
    mode_probability: Share = 1.0
    terms: list[SourceTerm] = []
    feedback: Feedback | None = None


class Track(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One object of the picture.

    Attributes:
        id: stable over its life.
        position_m, velocity_mps: (east, north) or (east, north, up) in the picture's axes.
        covariance: of position and velocity together.
        existence: probability that there is such an object.
        classes: name -> posterior probability.
        carriers: that contribute; logs: newest log of each source that does.
        status: tentative or confirmed; bearing_only while its range is undetermined.
    """

    id: Text
    position_m: Annotated[list[Metres], Meta(min_length=2, max_length=3)]
    velocity_mps: Annotated[list[MetresPerSecond], Meta(min_length=2, max_length=3)]
    covariance: Triangle
    existence: Share
    status: Literal["tentative", "confirmed", "bearing_only"] = "confirmed"
    classes: dict[Text, Share] = {}
    carriers: list[Id] = []
    logs: list[LogId] = []


class BearingLine(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What the bearings of one passive source say of one target, at the last of them.

    Attributes:
        id: carrier/source/name of the target there.
        status: of the range; without a range no place is told, only the line and its interval.
        t_ns: of the last bearing; observer_m: (east, north) of the carrier then.
        bearing_rad: by the solution, clockwise from the picture's north; with its rate and the rate
            of the range by the range.
        range_low_m, range_high_m: 95 % interval; no upper end: it is open.
        position_m, velocity_mps, covariance: as of a track, unless the range is undetermined.
        motion: the most probable one, with its probability; runner_up: the next.
        p_value: of the bearings' chi2; alarm: no motion that was tried explains them.
        bearings: how many the solution rests on.
        carriers: of whose bearings, when they are of several: the covariance holds what their
            frames leave unsure, and id names them and the target.
    """

    id: Text
    status: Literal["determined", "weak", "undetermined"]
    t_ns: TimeNs
    observer_m: Annotated[list[Metres], Meta(min_length=2, max_length=2)]
    bearing_rad: Angle
    sigma_bearing_rad: Annotated[float, Meta(ge=0, le=1e12)]
    bearing_rate_rad_s: Real = 0.0
    range_rate_by_range_hz: Real = 0.0
    range_low_m: Annotated[float, Meta(ge=0, le=1e9)] = 0.0
    range_high_m: Annotated[float, Meta(ge=0, le=1e9)] | None = None
    position_m: Annotated[list[Metres], Meta(min_length=2, max_length=2)] | None = None
    velocity_mps: Annotated[list[MetresPerSecond], Meta(min_length=2, max_length=2)] | None = None
    covariance: Triangle | None = None
    motion: Text = ""
    motion_probability: Share = 0.0
    runner_up: Text = ""
    p_value: Share = 1.0
    alarm: bool = False
    bearings: Count = 0
    carriers: list[Text] = []


class Tracks(Output, frozen=True, kw_only=True, omit_defaults=True):
    """The picture at one instant.

    Attributes:
        tracks: objects with a place.
        lines: what bearings alone say of theirs.
        objects: number of them expected where any sensor has looked, shown as tracks or not.
    """

    tracks: list[Track] = []
    lines: list[BearingLine] = []
    objects: Annotated[float, Meta(ge=0, le=1e9)] = 0.0
    sigma_objects: Annotated[float, Meta(ge=0, le=1e9)] = 0.0


class AssociatedTarget(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Logs of several carriers taken for one target, and by what.

    Attributes:
        logs: newest of each source, carrier/n/stream/seq/index.
        log_ratio_coordinates, log_ratio_features: what each adds to the log-likelihood ratio of
            the least sure pair, where features had a say beside coordinates.
    """

    logs: list[LogId]
    method: Literal["identity", "coordinates", "operator"]
    probability: Share = 1.0
    log_ratio_coordinates: Real = 0.0
    log_ratio_features: Real = 0.0


class Association(Output, frozen=True, kw_only=True, omit_defaults=True):
    """Which logs of this Closed belong together; those that stand alone are only counted."""

    targets: list[AssociatedTarget] = []
    alone: dict[Id, int] = {}


class AlignedBeacon(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Where a beacon is, with the 2 x 2 or 3 x 3 covariance and what is not observable.

    Attributes:
        position_m: (east, north[, up]) in the axes of the scenario's origin.
        unobservable: directions in which the ranges leave its place as it was known before.
        carrier: from whose ranges; of several carriers, all names.
    """

    beacon: Id
    position_m: Annotated[list[Metres], Meta(min_length=2, max_length=3)]
    covariance: Triangle
    unobservable: list[Text] = []
    carrier: Text = ""


class AlignedCarrier(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What ranges to beacons and other carriers, and targets in common, tell of a carrier.

    A sigma of 0 is that of a constant which the scenario declares to be known.

    Attributes:
        status: of the least determined combination of constants.
        t_ns: what the place is of.
        position_m: (east, north) in the axes of the scenario's origin, with its 2 x 2 covariance.
        current_mps: (east, north) of what it moves in, with its 2 x 2 covariance.
        north_rad: bearing of its own north, clockwise from true north.
        speed_scale: by which it moves faster than its log shows, as a share.
        range_scale: by which its ranges read long, as a share.
        range_bias_m: what its ranges read too long, the clock behind pseudoranges included, at the
            first message; it grows by `clock_drift_mps`.
        ranges: that have been used.
        stamp_s: by which its clock stamps messages later than that of the own carrier; stamp_drift:
            by how much more in every second.
        logs: of targets that have been used.
        terms: systematic errors of its sources, `time_s` against the own carrier's clock.
        unobservable: combinations of constants, beacons' included, that the ranges leave as they
            were known before.
    """

    carrier: Id
    status: Literal["determined", "weak", "undetermined"]
    t_ns: TimeNs
    position_m: Annotated[list[Metres], Meta(min_length=2, max_length=2)]
    covariance: Triangle
    current_mps: Annotated[list[MetresPerSecond], Meta(min_length=2, max_length=2)]
    current_covariance: Triangle
    north_rad: Real = 0.0
    sigma_north_rad: Real = 0.0
    speed_scale: Real = 0.0
    sigma_speed_scale: Real = 0.0
    range_scale: Real = 0.0
    sigma_range_scale: Real = 0.0
    range_bias_m: Real = 0.0
    sigma_range_bias_m: Real = 0.0
    clock_drift_mps: Real = 0.0
    sigma_clock_drift_mps: Real = 0.0
    ranges: Count = 0
    unobservable: list[Text] = []
    stamp_s: Real = 0.0
    sigma_stamp_s: Real = 0.0
    stamp_drift: Real = 0.0
    sigma_stamp_drift: Real = 0.0
    logs: Count = 0
    terms: list[SourceTerm] = []


class Alignment(Output, frozen=True, kw_only=True, omit_defaults=True):
    """System alignment: carriers and beacons, from ranges and targets in common (papers 003, 004).

    There is none in a run that declares neither beacons nor ranges.

    Attributes:
        beacons: that are ranged to.
        carriers: that range, or are ranged to.
    """

    beacons: list[AlignedBeacon] = []
    carriers: list[AlignedCarrier] = []


class FeatureQuality(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How well a source reports a feature, as confident pairs have shown.

    Attributes:
        pairs: that it rests on.
        declared_sigma, learned_sigma: of a number; 0 of a word.
        declared_right, learned_right: share of a word's reports that are right; 0 of a number.
    """

    pairs: Annotated[float, Meta(ge=0, le=1e12)] = 0.0
    declared_sigma: Annotated[float, Meta(ge=0, le=1e18)] = 0.0
    learned_sigma: Annotated[float, Meta(ge=0, le=1e18)] = 0.0
    declared_right: Share = 0.0
    learned_right: Share = 0.0


class SourceQuality(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """How one source did at this Closed.

    Attributes:
        logs: fused; late: not fused because too old; associated: with another carrier's log.
        sigma_defaults: logs that brought no sigma of their own.
        unknown_corrections: messages that name a correction which was never sent, or do not say
            what they are without it; no report of that kind is fused.
        nis: mean normalised squared misclosure per degree of freedom, `nis_dof` of them.
        taken, lone: plots that are of a track of the picture, and of none.
        track_nis: as `nis`, of the taken plots and what their tracks had foretold.
        features: name -> how well it is reported.
        flag: what looks wrong, in words.
    """

    carrier: Id
    source: Id
    logs: Count = 0
    late: Count = 0
    associated: Count = 0
    sigma_defaults: Count = 0
    unknown_corrections: Count = 0
    nis: Annotated[float, Meta(ge=0, le=1e18)] = 0.0
    nis_dof: Count = 0
    taken: Count = 0
    lone: Count = 0
    track_nis: Annotated[float, Meta(ge=0, le=1e18)] = 0.0
    track_nis_dof: Count = 0
    features: dict[Id, FeatureQuality] = {}
    flag: Text = ""


class Quality(Output, frozen=True, kw_only=True, omit_defaults=True):
    """How well what was said agrees, source by source."""

    sources: list[SourceQuality] = []
    late: Count = 0
    gave_up: Count = 0
    messages: Count = 0
