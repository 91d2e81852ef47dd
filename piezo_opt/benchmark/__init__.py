"""Benchmarks: what the package finds, and how fast, on records whose truth is known."""
