"""Commands of the console script ``jansen-env``, one module per command."""
