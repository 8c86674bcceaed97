"""Builds the engine into the wheel, for the platform JANSEN_ENV_TARGET, a variable, or this one."""

import os
import subprocess
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ENGINE = Path(__file__).parent / "jansen_env" / "engine"


def build(*options: str) -> str:
    """Run the build for the target; return the last line that it prints."""
    target = os.environ.get("JANSEN_ENV_TARGET", "")
    command = [sys.executable, str(ENGINE / "build.py"), *options, *target.split()]
    printed = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return printed.strip().rpartition("\n")[2]


class BuildEngine(build_py):
    """Builds the library beside its sources, if it is missing there; a wheel gets a copy.

    For another platform than this one it is built into the wheel alone.
    """

    def run(self) -> None:
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
    """A wheel for every Python, but one platform."""

    def get_tag(self) -> tuple[str, str, str]:
        return "py3", "none", build("--tag")


setup(cmdclass={"bdist_wheel": PlatformWheel, "build_py": BuildEngine})
