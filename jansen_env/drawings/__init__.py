"""Drawings of a robot's parts at 1:1, sheets, assembly and bill of materials."""
