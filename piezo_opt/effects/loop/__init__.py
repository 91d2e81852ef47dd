"""Effects on the LOOP balance: they add to the rate of the hysteretic displacement."""
