"""Reproduction of sections 3 and 4 of *Dynamic Analysis and Modeling of Jansen Mechanism*.

``jansen-env paper --out DIR`` draws the figures of the paper and writes a table that compares each
claim of the paper with our result. ``docs/paper.md`` contains reasons, interpretations and errata.
"""
