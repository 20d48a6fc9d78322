"""Carriers and the beacons they range to (003)."""
