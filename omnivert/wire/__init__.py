"""How messages travel and rest: bytes, channels, the bus, recordings."""
