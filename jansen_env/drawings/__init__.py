"""Drawings of a robot's parts at 1:1, sheets, instructions and bill of materials."""
