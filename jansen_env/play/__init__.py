"""Walk a robot by hand: ``python -m jansen_env.play``, in a window or with ``--web`` on a page."""
