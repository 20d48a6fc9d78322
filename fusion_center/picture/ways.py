"""How targets move and where tracks may begin: the settings as the tracker has them."""

from __future__ import annotations

from estimation.tracking import tracker
from estimation.tracking.imm import Motion
from estimation.tracking.undetected import Region

from ..settings import PictureSettings
from ..sources.features import layout
from ..state import State
from .classes import classes_of

OUT_OF = (0, 1, 1, 3)
"""Of quiet, changing speed, turning, manoeuvring hard: the way that each is taken up out of."""

LOUDER_S, QUIETER_S = (6000.0, 240.0, 120.0, 200.0), (2400.0, 100.0, 100.0, 10.0)
"""Mean times until a target takes each of these up, and until it falls back. Whoever has gone
straight for long is taken for one that hardly ever turns; after a turn more are expected."""

SLOWER, HARDER = 0.25, 4.0
"""Times the density of the speed of what changes it is that of what turns; and times the densities
of turn rate and speed are those of what manoeuvres hard."""


def motion_of(settings: PictureSettings) -> Motion:
    """Steady, quiet, changing speed, turning, manoeuvring hard: who turns seldom changes speed."""
    quiet, turning, hastening = settings.quiet_m2ps3, settings.turning_rad2ps, settings.hastening_ps
    return Motion(
        noise=(settings.steady_m2ps3, quiet, quiet, quiet, settings.manoeuvring_m2ps3),
        louder_s=LOUDER_S,
        quieter_s=QUIETER_S,
        sigma_speed_mps=settings.sigma_speed_mps,
        turning=(0.0, 0.0, 0.0, turning, HARDER * turning),
        hastening=(0.0, 0.0, hastening, SLOWER * hastening, HARDER * hastening),
        out_of=OUT_OF,
    )


def settings_of(state: State) -> tracker.Settings:
    """The settings as the tracker has them; at first every class is as likely."""
    settings, classes = state.settings.picture, max(len(classes_of(state.scenario)), 1)
    return tracker.Settings(
        motion=motion_of(settings),
        region=Region(half_m=settings.half_width_m),
        lifetime_s=settings.lifetime_s,
        gate=settings.gate,
        confirmed=settings.confirmed,
        classes=(1.0 / classes,) * classes,
        features=layout(state.picture.dictionary),
    )
