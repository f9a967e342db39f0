"""Builds the compiled core: C sources into one library, headers into Python declarations.

It imports nothing of the package, for `setup.py` runs it where only the build requirements are.
The library needs neither a C library nor Python: sine and cosine come from the compiler, so
answers are the same to the bit on all machines of an architecture.
"""

import argparse
import importlib.util
import os
import platform
import re
import subprocess
import sys
import tempfile
from contextlib import redirect_stdout
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import NamedTuple

SOURCES = Path(__file__).resolve().parent
"""Folder of the C sources and headers."""
BUILT = SOURCES / "built"
"""Folder of what is built from them in a source tree, and in an installed package."""
FLAGS = (
    *("-std=c11", "-O2", "-g0", "-s", "-fPIC", "-shared", "-Wl,-Bsymbolic"),
    # Every operation is rounded as it is written, on every machine.
    *("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
    *("-nostdlib", "-rtlib=compiler-rt"),
    *("-Wall", "-Wextra", "-Wconversion", "-Wno-sign-conversion", "-Wshadow", "-Wvla"),
    *("-Wmissing-prototypes", "-Wdouble-promotion", "-Werror"),
)
"""Arguments of the compiler beside the machine and the files."""
_PREFIX = "robo47_core_"


class Target(NamedTuple):
    """A kind of machine that the core is built for."""

    triple: str
    """Machine, system and least version of its C library, in the compiler's words."""
    cpu: str
    """Least processor; numpy's wheels need the same."""
    suffix: str
    """Of the library's name."""
    tag: str
    """Platform tag of the wheel."""


_TARGETS = {
    ("Linux", "x86_64"): Target(
        "x86_64-linux-gnu.2.28", "x86_64_v2", ".so", "manylinux_2_28_x86_64"
    ),
    ("Linux", "aarch64"): Target(
        "aarch64-linux-gnu.2.28", "baseline", ".so", "manylinux_2_28_aarch64"
    ),
    ("Darwin", "x86_64"): Target("x86_64-macos.11.0", "x86_64_v2", ".dylib", "macosx_11_0_x86_64"),
    ("Darwin", "arm64"): Target("aarch64-macos.11.0", "baseline", ".dylib", "macosx_11_0_arm64"),
}


class BuildError(Exception):
    """The core cannot be built; the message says why."""


class Built(NamedTuple):
    """Where the core of the present sources lies, once it is built."""

    library: Path
    """Shared library."""
    declarations: Path
    """cffi's declarations of it, a Python module."""

    @property
    def there(self) -> bool:
        """True where it is built."""
        return self.library.exists() and self.declarations.exists()


def target() -> Target:
    """Return the kind of this machine.

    Raises:
        BuildError: The core is not built for it.
    """
    found = platform.system(), platform.machine()
    if found not in _TARGETS:
        known = ", ".join(" ".join(names) for names in _TARGETS)
        raise BuildError(f"the compiled core is built for {known}, not for {' '.join(found)}")
    return _TARGETS[found]


def built(folder: Path = BUILT) -> Built:
    """Return where the core lies: names hold a digest of the sources, the flags and the machine.

    A changed source has another name, so an old library is never taken for it.

    Raises:
        BuildError: The core is not built for this machine.
    """
    machine = target()
    digest = sha256(repr((FLAGS, machine)).encode())
    for path in (*_files("*.c"), *_files("*.h"), Path(__file__)):
        digest.update(f"\n{path.name}\n".encode() + path.read_bytes())
    name = f"{_PREFIX}{digest.hexdigest()[:16]}"
    return Built(folder / f"{name}{machine.suffix}", folder / f"{name}.cffi")


def build(folder: Path = BUILT) -> Built:
    """Build the core into a folder, unless it is there, and remove older ones from it.

    Raises:
        BuildError: The sources do not compile, ziglang or cffi is missing, or the folder cannot
            be written.
    """
    made = built(folder)
    if made.there:
        return made
    for needed in ("ziglang", "cffi"):
        if importlib.util.find_spec(needed) is None:
            raise BuildError(f"building the compiled core needs the Python package {needed}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as name:
            part = Built(Path(name) / made.library.name, Path(name) / made.declarations.name)
            _compile(part.library, Path(name))
            _declare(part.declarations)
            # Whole files under their names at once: several processes may build.
            part.library.replace(made.library)
            part.declarations.replace(made.declarations)
    except OSError as error:
        raise BuildError(f"the compiled core cannot be written to {folder}: {error}") from error
    for old in folder.glob(f"{_PREFIX}*"):
        if old.stem != made.library.stem:
            old.unlink(missing_ok=True)
    return made


def _files(pattern: str) -> list[Path]:
    return sorted(SOURCES.glob(pattern))


def _compile(library: Path, scratch: Path) -> None:
    machine = target()
    command = [sys.executable, "-m", "ziglang", "cc", "-target", machine.triple]
    command += [f"-mcpu={machine.cpu}", *FLAGS, "-o", str(library), *map(str, _files("*.c"))]
    # What the compiler leaves beside its own cache goes away with the scratch folder.
    environment = {**os.environ, "ZIG_LOCAL_CACHE_DIR": str(scratch / "cache")}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode:
        raise BuildError(f"the C sources of the core do not compile:\n{done.stderr.strip()}")


def _declare(path: Path) -> None:
    """Write a Python module that declares all that the headers declare."""
    from cffi import FFI

    ffi = FFI()
    ffi.cdef("\n".join(declarations()))
    ffi.set_source(path.stem, None)
    # cffi takes no other suffix, and prints what it does.
    module = path.with_suffix(".py")
    with redirect_stdout(StringIO()):
        ffi.emit_python_code(str(module))
    module.replace(path)


def declarations() -> list[str]:
    """Return the text of all headers for cffi: each after those that it includes.

    Headers hold declarations only; `*_inline.h` hold helpers of the C files and are left out.
    """
    texts: dict[str, str] = {}

    def add(header: Path) -> None:
        if header.name in texts or header.name.endswith("_inline.h"):
            return
        text = header.read_text(encoding="utf-8")
        for name in re.findall(r'^#include "(\w+\.h)"', text, re.MULTILINE):
            add(SOURCES / name)
        texts[header.name] = re.sub(r"^#.*$", "", text, flags=re.MULTILINE)

    for header in _files("*.h"):
        add(header)
    return list(texts.values())


def main() -> None:
    """Build the core, into the source tree unless a folder is given."""
    parser = argparse.ArgumentParser(description="Build the compiled core.")
    parser.add_argument("folder", type=Path, nargs="?", default=BUILT)
    try:
        made = build(parser.parse_args().folder)
    except BuildError as error:
        sys.exit(f"error: {error}")
    print(f"{made.library.name}: {made.library.stat().st_size} bytes")


if __name__ == "__main__":
    main()
