"""Carriers that range to each other and to beacons: one joint state, fed by all they say."""
