"""Finds the files of MuJoCo Menagerie."""

import os
from importlib import import_module
from pathlib import Path
from typing import Any

from robo47_qp.errors import InvalidValueError, MenagerieError, MissingExtraError

ROOT_VARIABLE = "MENAGERIE_ROOT"
"""Environment variable that names a checkout of MuJoCo Menagerie."""


def menagerie_file(model: str) -> Path:
    """Return the MJCF file of a model such as "kuka_iiwa_14/iiwa14" (directory/file).

    It comes from the checkout that MENAGERIE_ROOT names; without that variable, from the
    package mujoco-menagerie, which fetches a model at first use.

    Raises:
        InvalidValueError: `model` is not of that form.
        MenagerieError: The file does not exist, or cannot be fetched.
        MissingExtraError: There is neither a checkout nor the package.
    """
    directory, slash, entry = model.partition("/")
    if not (directory and slash and entry) or "/" in entry or ".." in model:
        raise InvalidValueError("Menagerie model", repr(model), "of the form 'directory/file'")
    root = os.environ.get(ROOT_VARIABLE)
    folder = Path(root) / directory if root else _fetched(model, directory)
    found = folder / f"{entry}.xml"
    if not found.is_file():
        there = ", ".join(sorted(path.stem for path in folder.glob("*.xml"))) or "none"
        why = f"there is no {found.name}; models there: {there}"
        if not folder.is_dir():
            why = f"there is no such folder; {ROOT_VARIABLE} must name a checkout of Menagerie"
        raise MenagerieError(model, str(folder), why)
    return found


def _fetched(model: str, directory: str) -> Path:
    try:
        package: Any = import_module("mujoco_menagerie")
    except ImportError as error:
        wanted = f"Menagerie's {model}, as {ROOT_VARIABLE} names no checkout,"
        raise MissingExtraError(wanted, "mujoco-menagerie", "visuals") from error
    try:
        return Path(package.get(directory).path())
    except (package.MenagerieError, OSError, ValueError) as error:
        raise MenagerieError(model, "the package mujoco-menagerie", str(error)) from error
