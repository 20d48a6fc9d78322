"""Carriers: each believes its own navigation and reports what its own sensors see."""
