"""The console script ``jansen-env``, whose commands use existing robots and policies."""

from __future__ import annotations

from pathlib import Path

from jansen_env.cli.dispatch import run_command

COMMANDS = {
    "demo": "watch a trained policy within seconds, on a page in a browser",
    "enjoy": "watch policies, in a window or as a video",
    "evaluate": "compare the scores of policies",
    "benchmark": "score policies by the benchmark protocol, and compare results",
    "verify": "compare walks simulated on this machine with the published ones, bit for bit",
    "replay": "write a web page that replays recorded episodes",
    "play": "control a robot by hand and design its legs, on a page in a browser",
    "paper": "run the simulation of the paper, draw its figures, and check its claims",
    "mjcf": "export a robot to MuJoCo",
}
"""Descriptions of the commands by name. Each command is a module of :mod:`jansen_env.cli`."""
EXTRAS = {"mujoco": "mujoco", "stable_baselines3": "train", "torch": "train"}
"""Packages that are not part of the extra ``tools``, and the extra that contains them."""
CHECKOUT = Path(__file__).parents[1] / "pyproject.toml"


def main(arguments: list[str] | None = None) -> None:
    """Run a command.

    Args:
        arguments: Arguments of the command line, beginning with the name of the command. None
            selects those of the process.

    Raises:
        SystemExit: If an argument is wrong, a package is missing, or the command is stopped.
    """
    run_command("jansen-env", COMMANDS, "jansen_env.cli", arguments, _installation)


def _installation(package: str) -> str:
    """Return the arguments of pip that install a missing package."""
    extra = f"[{EXTRAS.get(package, 'tools')}]"
    return f'-c constraints.txt -e ".{extra}"' if CHECKOUT.exists() else f'"jansen-env{extra}"'


if __name__ == "__main__":
    main()
