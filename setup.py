"""Puts the compiled core into the wheel, and into the source tree of an editable install."""

import importlib.util
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

CORE = Path("robo47_qp", "_core")
# By its path: importing the package would need all that it depends on.
_spec = importlib.util.spec_from_file_location("build", Path(__file__).parent / CORE / "build.py")
core = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(core)


class BuildWithCore(build_py):
    """Copies the Python files and builds the core beside them."""

    def run(self):
        """Build all."""
        super().run()
        core.build(core.BUILT if self.editable_mode else Path(self.build_lib, CORE, "built"))


class WithCore(Distribution):
    """A package that is not pure Python."""

    def has_ext_modules(self):
        """Say so."""
        return True


class WheelOfAMachine(bdist_wheel):
    """A wheel for a kind of machine and for every version of Python."""

    def get_tag(self):
        """Return the tag of the wheel: the core does not depend on the version of Python."""
        return "py3", "none", core.target().tag


setup(distclass=WithCore, cmdclass={"build_py": BuildWithCore, "bdist_wheel": WheelOfAMachine})
