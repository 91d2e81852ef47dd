"""Optimal identification, diagnosis and control of piezoelectric actuators."""
