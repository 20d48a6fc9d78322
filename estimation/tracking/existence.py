"""Is there a target at all? The probability of each track, look by look.

A plot where it is expected raises it by how much likelier a target is than clutter there, a look
without a plot lowers it by the chance of a miss. A track is confirmed, and given up, by it.

Source: Musicki, Evans & Stankovic, "Integrated probabilistic data association", IEEE Trans. AC 39,
1994, eqs 8-13, with the plot of the assignment in place of the mixture.
"""

from __future__ import annotations

import numpy as np

from estimation.arrays import Array

SUREST = 0.999
"""No track is surer of its target: one that is gone must be given up in a few looks."""


def seen(existence: Array, log_ratio: Array, detection: float) -> Array:
    """(k,) probabilities after a plot each (eqs 8-10): it may be of the target or of clutter."""
    odds = existence / (1 - existence) * (1 - detection + np.exp(np.minimum(log_ratio, 50.0)))
    return np.asarray(np.minimum(odds / (1 + odds), SUREST))


def missed(existence: Array, detection: float) -> Array:
    """(k,) probabilities after a look that should have seen the target and did not."""
    kept = existence * (1 - detection)
    return np.asarray(kept / (1 - existence + kept))
