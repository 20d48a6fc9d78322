"""Real sources as carriers: a feed brings bytes, a decoder understands them, a bridge publishes."""
