"""Robots in web browsers: their geometry as numbers, and the scripts that draw it.

The positions of the joints are computed in Python. The scripts only draw them and contain no
physics.
"""
