"""Solvers of the residuals of single shooting, one in each file."""
