"""What a recording's outputs are worth, by the truth in it: frames, pictures, alignment."""

from .alignment import (
    AlignmentError,
    AlignmentSummary,
    BeaconSummary,
    alignment_errors,
    summarise_alignment,
    summarise_beacons,
    true_beacons_m,
)
from .frames import (
    FrameError,
    FrameSummary,
    TrueFrame,
    frame_errors,
    said_errors,
    summarise,
    symmetric,
    true_frame,
)
from .pictures import (
    CUTOFF_M,
    Judge,
    Known,
    PictureError,
    PictureSummary,
    names_changed,
    picture_errors,
    summarise_picture,
)

__all__ = [
    "CUTOFF_M", "AlignmentError", "AlignmentSummary", "BeaconSummary", "FrameError",
    "FrameSummary", "Judge", "Known", "PictureError", "PictureSummary", "TrueFrame",
    "alignment_errors", "frame_errors", "names_changed", "picture_errors", "said_errors",
    "summarise", "summarise_alignment", "summarise_beacons", "summarise_picture", "symmetric",
    "true_beacons_m", "true_frame",
]  # fmt: skip
