"""Baseline controllers that policies are compared with."""
