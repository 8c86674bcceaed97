"""Policies: the protocol, the PID of the paper, and trained policies, which run with NumPy."""
