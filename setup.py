"""Build the package with its compiled engine.

The engine is built for the platform in the environment variable JANSEN_ENV_TARGET, or for this
machine if the variable is not set.
"""

import os
import subprocess
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ENGINE = Path(__file__).parent / "jansen_env" / "engine"


def build(*options: str) -> str:
    """Run the build script of the engine for the target platform.

    Args:
        *options: Options of the build script.

    Returns:
        The last line that the script prints.
    """
    target = os.environ.get("JANSEN_ENV_TARGET", "")
    command = [sys.executable, str(ENGINE / "build.py"), *options, *target.split()]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return printed.strip().rpartition("\n")[2]


class BuildEngine(build_py):
    """Build step that compiles the engine.

    The library is built next to its sources if it is missing there, and a wheel receives a copy.
    For another platform, the library is built only into the wheel.
    """

    def run(self) -> None:
        """Copy the Python files and build the engine."""
        super().run()
        wheel = Path(self.build_lib, "jansen_env", "engine")
        if "JANSEN_ENV_TARGET" in os.environ and not self.editable_mode:
            build("--folder", str(wheel))
            return
        library = Path(build("--missing"))
        if not self.editable_mode:
            for path in (library, library.with_suffix(".wasm")):
                self.copy_file(str(path), str(wheel))


class PlatformWheel(bdist_wheel):
    """Wheel that works with every version of Python 3, but only on one platform."""

    def get_tag(self) -> tuple[str, str, str]:
        """Return the Python, ABI and platform tags of the wheel."""
        return "py3", "none", build("--tag")


setup(cmdclass={"bdist_wheel": PlatformWheel, "build_py": BuildEngine})
