"""How targets move and where tracks may begin: the settings as the tracker has them."""

from __future__ import annotations

from estimation.tracking import tracker
from estimation.tracking.imm import Motion
from estimation.tracking.undetected import Region

from ..sources.features import layout
from ..state import State
from .classes import classes_of

LOUDER_S, QUIETER_S = (6000.0, 120.0, 200.0), (2400.0, 100.0, 10.0)
"""Mean times until a target moves in the next louder way, and until one falls back. Whoever has
gone straight for long is taken for one that hardly ever turns; after a turn more are expected."""

HARDER = 4.0
"""Times the densities of turn rate and speed of what turns are those of what manoeuvres hard."""


def settings_of(state: State) -> tracker.Settings:
    """The settings as the tracker has them; at first every class is as likely."""
    settings, classes = state.settings.picture, max(len(classes_of(state.scenario)), 1)
    motion = Motion(
        noise=(
            settings.steady_m2ps3,
            settings.quiet_m2ps3,
            settings.quiet_m2ps3,
            settings.manoeuvring_m2ps3,
        ),
        louder_s=LOUDER_S,
        quieter_s=QUIETER_S,
        sigma_speed_mps=settings.sigma_speed_mps,
        turning=(0.0, 0.0, settings.turning_rad2ps, HARDER * settings.turning_rad2ps),
        hastening=(0.0, 0.0, settings.hastening_ps, HARDER * settings.hastening_ps),
    )
    return tracker.Settings(
        motion=motion,
        region=Region(half_m=settings.half_width_m),
        lifetime_s=settings.lifetime_s,
        gate=settings.gate,
        confirmed=settings.confirmed,
        classes=(1.0 / classes,) * classes,
        features=layout(state.picture.dictionary),
    )
