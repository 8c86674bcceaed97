"""*Dynamic Analysis and Modeling of Jansen Mechanism*, sections 3 and 4, reproduced.

``jansen-env paper --out DIR`` draws its figures and writes down, claim by claim, what the paper
says and what comes out here. Reasons, interpretations and errata: ``docs/paper.md``.
"""
