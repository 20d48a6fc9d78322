"""The simulated truth: scenarios, motion, navigation errors, sensors, clocks."""
