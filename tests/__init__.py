"""Tests: one folder a package, and papers, live (real processes), golden, project."""
