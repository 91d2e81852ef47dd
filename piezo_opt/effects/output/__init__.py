"""Effects on the OUTPUT line: between the position and the reading."""
