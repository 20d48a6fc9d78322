"""Carriers: processes that observe, navigate and publish what they believe."""
