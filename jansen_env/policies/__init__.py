"""Pretrained policies, which are read and run with NumPy."""
