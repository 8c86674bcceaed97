"""Walk a robot by hand on a page: ``jansen-env play``."""
