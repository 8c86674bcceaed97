"""The command ``python -m agents.export``."""

from agents.export import main

if __name__ == "__main__":
    main()
