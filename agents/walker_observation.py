"""Places in the observation of ``JansenWalker-v0``; see ``JansenWalkerEnv``."""

COS_CRANK, SIN_CRANK = 0, 1
CRANK_SPEED = 2  # rad/s
COMMAND = 9  # m/s
FIRST_LOAD = (
    10  # of the toes' loads / weight, of which there may be more or fewer; so from the end:
)
LAG = -5  # m, how far the target is ahead
