"""Equations of motion: the projection method, tables for the engine, and forces in the joints."""
