"""Removal of what a policy leaves: whatever its folder holds, it goes."""

import os
from pathlib import Path

from robo47_qp.run.policy.tree import remove_tree


def nested(folder: Path, depth: int, name: str) -> None:
    """Make folders within each other, deeper than a path can be long."""
    here = os.open(folder, os.O_RDONLY)
    for _ in range(depth):
        os.mkdir(name, dir_fd=here)
        inner = os.open(name, os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = inner
    os.close(os.open("file", os.O_CREAT | os.O_WRONLY, dir_fd=here))
    os.close(here)


def test_a_tree_of_any_depth_goes(tmp_path: Path) -> None:
    folder = tmp_path / "policy"
    folder.mkdir()
    nested(folder, 3000, "d")
    nested(folder, 100, "long" * 60)
    remove_tree(folder)
    assert list(tmp_path.iterdir()) == []


def test_folders_that_are_shut_and_ends_of_links_are_told_apart(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "policy", tmp_path / "elsewhere"
    shut = folder / "shut" / "shut"
    shut.mkdir(parents=True)
    elsewhere.mkdir()
    (elsewhere / "kept").write_text("mine")
    elsewhere.chmod(0o500)
    (shut / "link").symlink_to(elsewhere)
    (shut / "gone").symlink_to("nowhere")
    os.mkfifo(shut / "fifo")
    for one in (shut, shut.parent, folder):
        one.chmod(0)
    remove_tree(folder)
    assert list(tmp_path.iterdir()) == [elsewhere]
    assert elsewhere.stat().st_mode & 0o777 == 0o500
    assert (elsewhere / "kept").read_text() == "mine"


def test_a_link_in_place_of_the_folder_goes_and_its_end_stays(tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "kept").write_text("mine")
    (tmp_path / "policy").symlink_to(elsewhere)
    remove_tree(tmp_path / "policy")
    remove_tree(tmp_path / "none")
    assert [path.name for path in tmp_path.rglob("*")] == ["elsewhere", "kept"]
