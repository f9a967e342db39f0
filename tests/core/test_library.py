"""The compiled core: what is loaded is what the sources say, and nothing else in silence."""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from robo47_qp._core import build as core_build
from robo47_qp._core import library
from robo47_qp.errors import CoreError, UnknownNameError


@pytest.fixture
def sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the C sources, none of it built."""
    copy = tmp_path / "core"
    copy.mkdir()
    for path in core_build.SOURCES.glob("*.[ch]"):
        shutil.copy(path, copy)
    monkeypatch.setattr(core_build, "SOURCES", copy)
    return copy


def test_a_changed_source_has_another_library(sources: Path, tmp_path: Path) -> None:
    before = core_build.built(tmp_path)
    assert core_build.built(tmp_path) == before
    with (sources / "chain.c").open("a") as file:
        file.write("\n")
    changed = core_build.built(tmp_path)
    (sources / "chain.c").rename(sources / "another.c")
    renamed = core_build.built(tmp_path)
    assert len({before.library, changed.library, renamed.library}) == 3
    assert not changed.there


def test_older_libraries_go_away(sources: Path, tmp_path: Path) -> None:
    old = tmp_path / "robo47_core_0123456789abcdef.so"
    old.write_bytes(b"")
    made = core_build.build(tmp_path)
    assert made.there
    assert sorted(path.name for path in tmp_path.glob("robo47*")) == sorted(
        path.name for path in made
    )
    written = made.library.stat().st_mtime_ns
    assert core_build.build(tmp_path).library.stat().st_mtime_ns == written


def test_a_mistake_in_a_source_is_told(sources: Path, tmp_path: Path) -> None:
    with (sources / "chain.c").open("a") as file:
        file.write("int unfinished(void) { return undeclared; }\n")
    with pytest.raises(core_build.BuildError, match=r"do not compile:(?s:.)*undeclared"):
        core_build.build(tmp_path / "built")
    assert not list((tmp_path / "built").iterdir())


def test_without_a_library_and_a_compiler_the_core_says_what_to_do(
    sources: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (sources / "new.h").write_text("void r47_new(void);\n")
    missing = {"ziglang"}
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name in missing else find(name)
    )
    load = library._loaded.__wrapped__
    with pytest.raises(CoreError, match=r"none of the present C sources.*`make core`.*=numpy"):
        load()
    with pytest.raises(core_build.BuildError, match="needs the Python package ziglang"):
        core_build.build(sources / "built")
    monkeypatch.setattr(platform, "machine", lambda: "vax")
    with pytest.raises(CoreError, match=r"built for Linux x86_64, .* not for \w+ vax"):
        load()


def test_the_library_needs_no_other() -> None:
    library.functions()
    data = core_build.built().library.read_bytes()
    assert not [name for name in (b"libc.so", b"libm.so", b"ld-linux") if name in data]


def test_the_backend_is_chosen_by_name() -> None:
    with library.using("numpy"):
        assert library.backend() == "numpy"
        with library.using("compiled"):
            assert library.backend() == "compiled"
    unknown = r"No backend .* 'fortran'; known: compiled, numpy"
    with pytest.raises(UnknownNameError, match=unknown), library.using("fortran"):
        pass


@pytest.mark.parametrize(("value", "told"), [("numpy", "numpy"), ("", "compiled"), ("c", "known")])
def test_the_environment_chooses_the_backend(value: str, told: str) -> None:
    code = (
        "from robo47_qp._core.library import backend\nfrom robo47_qp.errors import UnknownNameError"
        "\ntry:\n    print(backend())\nexcept UnknownNameError as error:\n    print(error)"
    )
    environment = {**os.environ, library.VARIABLE: value}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert told in done.stdout


@pytest.mark.parametrize(
    "array",
    [np.zeros((3, 4)).T, np.zeros(6)[::2], np.zeros(2, dtype=np.int16), np.zeros(2, dtype=">f8")],
)
def test_arrays_of_another_layout_are_refused(array: NDArray[Any]) -> None:
    with pytest.raises(TypeError, match="the core takes contiguous"):
        library.pointer(array)


def test_arguments_of_another_type_are_refused() -> None:
    with pytest.raises(TypeError):
        library.functions().r47_links(library.pointer(np.zeros(7)), None, None)
