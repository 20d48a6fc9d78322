"""The truth of a run: scenarios, motions, carriers' errors, sensors; pure, without bus or clock."""
