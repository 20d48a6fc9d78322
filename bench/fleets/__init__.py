"""What the fusion centre makes of random fleets."""
