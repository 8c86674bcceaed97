"""Commands of the console script ``jansen-workshop``, one module per command."""
