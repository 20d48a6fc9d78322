"""Where each carrier's frame lies against the own one: searched, followed, published (000)."""
