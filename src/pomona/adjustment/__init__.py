"""Least squares of cameras: bundle adjustment with what is known beforehand, and what it leaves uncertain."""
