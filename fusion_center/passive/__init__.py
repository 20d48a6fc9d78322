"""Carriers that report bearings only: their frames, and what their lines say of targets (001)."""
