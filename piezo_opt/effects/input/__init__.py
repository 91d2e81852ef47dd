"""Effects on the INPUT line: between the recorded command and the drive."""
