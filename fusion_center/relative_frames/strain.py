"""Ranges that read longer or shorter than others allow, of sources that declare no such error.

What an event says of a bias is independent from event to event where there is none, so that its
sum tells a small one from chance. Scores are forgotten over about fifty events. What is named is
the one source whose bias explains most; it is still fused as it declares itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, sqrt

from msgspec.structs import replace

from schemas.messages import SourceProperties

from ..quality import Tally
from ..state import State, Strain
from . import frames

KEPT = 0.98
"""Of the sums from event to event."""
CHANCE = 6.0
"""Sigmas beyond which it is none; models of targets are not that exact for less."""
WORTH = 0.25
"""Of the sigma of a range, from which a bias is worth naming."""


def watched(
    state: State, names: Sequence[str], scores: Sequence[tuple[float, float]], tally: Tally
) -> State:
    """The state after what an event says of the ranges of these carriers, told in `tally`."""
    strains = dict(state.strains)
    for name, (score, information) in zip(names, scores, strict=False):
        source = frames.ranging_source(state, name)
        if not source or not isfinite(score) or not 0 < information < float("inf"):
            continue
        address = f"{name}/{source}"
        before = strains.get(address, Strain())
        strains[address] = Strain(
            score=KEPT * before.score + score,
            information=KEPT * before.information + information,
            variance=KEPT**2 * before.variance + information,
        )
    found = {address: _sigmas(state, address, strain) for address, strain in strains.items()}
    worst = max(found, key=lambda address: found[address], default="")
    if worst and found[worst] > CHANCE:
        longer = "longer" if strains[worst].score < 0 else "shorter"
        tally.strained(*_parts(worst), f"ranges read {longer} than others allow, undeclared")
    return replace(state, strains=strains)


def _sigmas(state: State, address: str, strain: Strain) -> float:
    """By how many sigmas a bias shows; none where one is declared, or where it is small."""
    name, source = _parts(address)
    properties = state.sources(name).get(source, SourceProperties())
    if properties.sigma_range_bias_m or properties.sigma_range_scale:
        return 0.0
    bias_m = abs(strain.score) / strain.information
    worth = bias_m > WORTH * (properties.sigma_range_m or 0.0)
    return abs(strain.score) / sqrt(strain.variance) if worth else 0.0


def _parts(address: str) -> tuple[str, str]:
    name, _, source = address.partition("/")
    return name, source
