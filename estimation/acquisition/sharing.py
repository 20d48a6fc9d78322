"""How many targets two carriers have in common: nobody knows, so every share is weighed.

Of n1 and n2 logs on an area A, u are expected to be of common targets. Shared targets have the
density u / A and each carrier's own ones (n - u) / A, all Poisson, so K pairs have the weight
(A u)^K (n1 - u)^(n1 - K) (n2 - u)^(n2 - K) e^u times the densities of their misclosures. The
share w = u / min(n1, n2) is taken as uniform on a grid of (0, 1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimation.arrays import Array

_SHARES = (np.arange(40) + 0.5) / 40
_EXPECTED = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Sharing:
    """The weights of numbers of pairs.

    Attributes:
        log_area: ln A [m^2].
        log_odds: (shares) ln u / ((n1 - u) (n2 - u)), what one more pair is worth.
        log_none: (shares) of no pair at all.
    """

    log_area: float
    log_odds: Array
    log_none: Array

    @classmethod
    def of(cls, n1: int, n2: int, area_m2: float) -> Sharing:
        """For numbers of logs, each at least one."""
        u = _SHARES * min(n1, n2)
        alone = np.log(n1 - u), np.log(n2 - u)
        odds = np.log(u) - alone[0] - alone[1]
        return cls(float(np.log(area_m2)), odds, n1 * alone[0] + n2 * alone[1] + u)

    @property
    def worth_at_first(self) -> float:
        """Log worth of a pair [m^2] when half of the logs are expected to be common."""
        return float(np.interp(_EXPECTED, _SHARES, self.log_odds)) + self.log_area

    def log_weight(self, pairs: int) -> float:
        """Log weight [m^2K] of K pairs, against that of none."""
        terms = pairs * self.log_odds + self.log_none
        return float(_log_sum(terms) - _log_sum(self.log_none)) + pairs * self.log_area

    def worth(self, pairs: int) -> float:
        """Log worth of a pair [m^2], averaged over the shares that K pairs speak for."""
        terms = pairs * self.log_odds + self.log_none
        chance = np.exp(terms - terms.max())
        return float(self.log_odds @ chance / chance.sum()) + self.log_area


def _log_sum(terms: Array) -> float:
    top = terms.max()
    return float(top + np.log(np.exp(terms - top).sum()))
