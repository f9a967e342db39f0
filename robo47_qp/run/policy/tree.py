"""Removal of a folder with whatever a policy has put into it."""

import os
from contextlib import suppress
from itertools import count
from pathlib import Path
from secrets import token_hex

_FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW


def remove_tree(folder: Path) -> None:
    """Remove a folder and all in it, however deep; links are removed, and not followed.

    `shutil.rmtree` goes down as deep as the folders are, until Python's stack or the open files
    end. Here inner folders are moved to the top before they are emptied. What cannot be removed
    stays.
    """
    with suppress(OSError):
        if folder.is_symlink():
            folder.unlink()
            return
        folder.chmod(0o700)
        top = os.open(folder, _FOLDER)
        try:
            _empty(top)
        finally:
            os.close(top)
        folder.rmdir()


def _empty(top: int) -> None:
    waiting, token, numbers = [os.curdir], token_hex(8), count()
    while waiting:
        name = waiting.pop()
        with suppress(OSError):
            inner = os.open(name, _FOLDER, dir_fd=top)
            try:
                for one in [entry.name for entry in os.scandir(inner)]:
                    fresh = f"{token}{next(numbers)}"
                    if _moved(one, inner, fresh, top):
                        waiting.append(fresh)
            finally:
                os.close(inner)
            if name != os.curdir:
                os.rmdir(name, dir_fd=top)


def _moved(name: str, inner: int, fresh: str, top: int) -> bool:
    """Unlink what is no folder; move a folder to the top, and return True."""
    with suppress(OSError):
        try:
            os.unlink(name, dir_fd=inner)
        except (IsADirectoryError, PermissionError):
            # Its owner may have taken the rights to read it and to move it.
            os.chmod(name, 0o700, dir_fd=inner)
            os.rename(name, fresh, src_dir_fd=inner, dst_dir_fd=top)
            return True
    return False
