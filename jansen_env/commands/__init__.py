"""Commands of the console script ``jansen-env``, a module each."""
