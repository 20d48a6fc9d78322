"""How messages move: the interface, Zenoh behind it, and a double of it for tests."""
