"""Drawings of a robot's parts at 1:1, sheets to cut, instructions, and bill of materials."""
