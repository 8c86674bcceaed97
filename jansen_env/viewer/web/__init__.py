"""Robots in browsers: their geometry in numbers, and the scripts that draw it.

Joints are computed here, in Python; the scripts draw and know no physics.
"""
