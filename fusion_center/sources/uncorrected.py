"""Takes out what carriers have put into their messages of corrections, before anything is fused.

The fusion works with the frames that carriers have of themselves. A correction is an outcome of
it: fused once more as if a carrier had found it, it would be counted twice.
"""

from __future__ import annotations

from schemas.feedback import is_sent, uncorrected
from schemas.messages import Input, Navigation, SourceReport

from ..quality import Tally
from ..timeline import Batch, Instant


def taken_out(batch: Batch, centre: str, step: int, tally: Tally) -> Batch:
    """The messages of a Closed as their carriers would say them without any correction.

    What cannot be taken out is counted: such a report is left out, and a Navigation is left as it
    is, from which its carrier's correction is suspended.

    Args:
        step: of the Closed; no correction of it has been sent yet.
    """
    instants = []
    for instant in batch.instants:
        plain = [_plain(message, centre, step, tally) for message in instant.messages]
        instants.append(Instant(instant.t_ns, [m for m in plain if m is not None]))
    return batch._replace(instants=[instant for instant in instants if instant.messages])


def _plain(message: Input, centre: str, step: int, tally: Tally) -> Input | None:
    """One message without the correction it holds; None if it cannot be fused."""
    name = message.correction_id if isinstance(message, Navigation | SourceReport) else ""
    if not name:
        return message
    if not is_sent(name, centre, message.carrier, step):
        tally.unknown_correction(message, f"holds {name}, which was never sent")
    else:
        try:
            return uncorrected(message)
        except ValueError as error:
            tally.unknown_correction(message, f"holds {name}: {error}")
    return message if isinstance(message, Navigation) else None
