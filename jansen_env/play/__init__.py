"""Walk a robot by hand on a page: ``python -m jansen_env.play``."""
