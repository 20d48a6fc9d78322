"""Replays: a recording's messages on the wire again, at their own pace or another."""
