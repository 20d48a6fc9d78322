"""crossfix: carriers that disagree about their frames, and the centre that fuses their views."""

__version__ = "0.1.0"
