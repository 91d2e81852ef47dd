"""Effects on the MOTION balance: they add to the acceleration."""
