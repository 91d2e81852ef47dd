"""Effects on the STRAIN balance: they add to the free displacement."""
