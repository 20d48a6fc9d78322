"""How a topic travels: three profiles, chosen by what a loss or a delay of it would cost."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Qos(NamedTuple):
    """Priority and congestion control of a publication.

    Nothing blocks: one slow third party would stall everyone. What is dropped is asked for again
    (`backfill`), so completeness does not depend on the transport.
    """

    name: str
    priority: Literal["real_time", "data_high", "data", "background"]
    express: bool


CONTROL = Qos("control", "real_time", express=True)
DATA = Qos("data", "data", express=False)
STATUS = Qos("status", "background", express=False)
