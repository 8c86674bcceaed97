"""Policies that come with the package, read and run with NumPy."""
