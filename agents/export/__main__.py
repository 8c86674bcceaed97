"""Entry point of the command ``python -m agents.export``."""

from agents.export import main
from jansen_env.cli.process import run

if __name__ == "__main__":
    run("python -m agents.export", main)
