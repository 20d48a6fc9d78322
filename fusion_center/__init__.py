"""The fusion centre: many carriers' target logs into one picture, without sight of the truth."""
