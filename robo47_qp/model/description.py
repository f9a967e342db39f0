"""Robots described by a TOML file beside their MJCF; docs/robots.md has the keys."""

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from mink import SE3, SO3

from robo47_qp.arrays import Rule, checked_vector
from robo47_qp.errors import InvalidValueError, ModelError, UnknownNameError
from robo47_qp.model.cell import Cell
from robo47_qp.model.gripper import Gripper
from robo47_qp.model.hands import TCP
from robo47_qp.model.hands import hand as known_hand
from robo47_qp.model.loading import Ratings, robot_from_mjcf
from robo47_qp.model.robot import Hand, MotionProfile, Robot, ToolFrame

ENDINGS = (".xml", ".mjcf", ".toml")
"""Endings of files that name a robot."""


@dataclass(frozen=True)
class _Kind(Rule):
    """A rule for values of a TOML file: their types, none of them converted; numbers are finite."""

    words: str
    types: tuple[type, ...]
    many: bool = False
    count: int | None = None
    """How many a list must have; None is any number."""

    def _accepts(self, value: Any) -> bool:
        if not self.many:
            return self._is_one(value)
        if not isinstance(value, list) or self.count not in (None, len(value)):
            return False
        return all(map(self._is_one, value))

    def _is_one(self, value: Any) -> bool:
        # To Python, true is a number.
        if type(value) not in self.types:
            return False
        return isinstance(value, str | bool) or abs(value) <= sys.float_info.max

    def __str__(self) -> str:
        return self.words


_FLAG = _Kind("true or false", (bool,))
_TEXT, _TEXTS = _Kind("a text", (str,)), _Kind("a list of texts", (str,), many=True)
_PAIR = _Kind("a list of two texts", (str,), many=True, count=2)
_NUMBER = _Kind("a finite number", (int, float))
_NUMBERS = _Kind("a list of finite numbers", (int, float), many=True)
_SPEEDS = ("v_max", "a_max", "j_max")
_RATINGS = (*_SPEEDS, "tau_max", "tau_rate_max", "stiffness")
_KEYS: dict[str, dict[str, _Kind]] = {
    "": {
        "name": _TEXT,
        "home": _NUMBERS,
        "joints": _TEXTS,
        "tcp": _TEXT,
        "armature": _NUMBERS,
        "neighbours_apart": _FLAG,
    },
    "tool": {"body": _TEXT, "position": _NUMBERS, "quaternion": _NUMBERS},
    "gripper": {
        "joints": _PAIR,
        "fingers": _PAIR,
        "actuator": _TEXT,
        "width_max": _NUMBER,
        "speed_max": _NUMBER,
        "force_max": _NUMBER,
        "force_gain": _NUMBER,
    },
    "hand": {"name": _TEXT, "mjcf": _TEXT, "site": _TEXT, "turn": _NUMBER},
    "ratings": dict.fromkeys(_RATINGS, _NUMBERS),
    "profile": dict.fromkeys(_SPEEDS, _NUMBERS),
    "cell": {"position": _NUMBERS, "yaw": _NUMBER},
}


def described_robot(file: Path | str) -> Robot:
    """Return the robot of an MJCF file with a TOML file of the same name beside it.

    Args:
        file: Either of the two.

    Raises:
        ModelError: One of the files does not exist or cannot be read.
        UnknownNameError: The description has an unknown key, or names what the MJCF lacks.
        InvalidValueError: A key is missing, or its value is not what it should be.
    """
    path = Path(file)
    toml = path.with_suffix(".toml")
    mjcf = path if path.suffix != ".toml" else _mjcf_of(path)
    if not toml.is_file():
        raise ModelError(
            f"The robot {path} needs a description {toml}: no such file. It names at least `home` "
            "and `tcp` (a site) or [tool] (a body and a pose)."
        )
    try:
        content = tomllib.loads(toml.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ModelError(f"The description {toml} cannot be read: {error}.") from error
    try:
        return _robot(mjcf, _checked(content))
    except InvalidValueError as error:
        raise InvalidValueError(f"{error.name} in {toml}", error.found, error.expected) from error


def _mjcf_of(toml: Path) -> Path:
    found = [toml.with_suffix(ending) for ending in ENDINGS[:2]]
    return next((one for one in found if one.is_file()), found[0])


def _checked(content: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the tables by name, the keys outside of all tables under the empty name."""
    tables: dict[str, dict[str, Any]] = {name: {} for name in _KEYS}
    for key, value in content.items():
        if isinstance(value, dict):
            if key not in _KEYS:
                raise UnknownNameError("table of a robot", key, tuple(filter(None, _KEYS)))
            tables[key] = value
        else:
            tables[""][key] = value
    for name, table in tables.items():
        for key, value in table.items():
            if name == "" and key in _KEYS:
                raise InvalidValueError(f"[{key}]", repr(value), "a table")
            if key not in _KEYS[name]:
                raise UnknownNameError(f"key of a robot's [{name}]", key, _KEYS[name])
            _KEYS[name][key].check(_title(name, key), value)
    return tables


def _robot(mjcf: Path, tables: Mapping[str, Mapping[str, Any]]) -> Robot:
    top, ratings = tables[""], tables["ratings"]
    gripper = _gripper(mjcf.parent, tables)
    tcp = _tool(tables, TCP if isinstance(gripper, Hand) else None)
    known = Ratings(
        rated=_profile(ratings, "ratings"),
        profile=_profile(tables["profile"], "profile"),
        **{name: ratings[name] for name in _RATINGS if name not in _SPEEDS and name in ratings},
    )
    robot = robot_from_mjcf(
        mjcf,
        tcp=tcp,
        home=_needed(top, "", "home"),
        name=top.get("name"),
        joints=top.get("joints"),
        gripper=gripper,
        ratings=known,
    )
    robot = replace(
        robot,
        armature=top.get("armature"),
        neighbours_apart=top.get("neighbours_apart", False),
    )
    cell = tables["cell"]
    if not cell:
        return robot
    x, y, z = checked_vector("position of [cell]", _needed(cell, "cell", "position"), 3)
    return Cell.at(x, y, z, float(cell.get("yaw", 0.0))).with_robot(robot)


def _profile(table: Mapping[str, Any], name: str) -> MotionProfile | None:
    if not table.keys() & set(_SPEEDS):
        return None
    return MotionProfile(**{key: _needed(table, name, key) for key in _SPEEDS})


def _tool(tables: Mapping[str, Mapping[str, Any]], default: str | None) -> str | ToolFrame:
    top, tool = tables[""], tables["tool"]
    if not tool:
        return str(top.get("tcp", default) if default else _needed(top, "", "tcp"))
    position = checked_vector("position of [tool]", tool.get("position", [0.0] * 3), 3)
    quaternion = checked_vector("quaternion of [tool]", tool.get("quaternion", [1, 0, 0, 0]), 4)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-3:
        raise InvalidValueError("quaternion of [tool]", quaternion.tolist(), "of length 1 (wxyz)")
    pose = SE3.from_rotation_and_translation(SO3(quaternion / length), position)
    return ToolFrame(body=str(_needed(tool, "tool", "body")), T_body_tcp=pose)


def _gripper(folder: Path, tables: Mapping[str, Mapping[str, Any]]) -> Gripper | Hand | None:
    gripper, hand = dict(tables["gripper"]), tables["hand"]
    for name in ("joints", "fingers"):
        if name in gripper:
            gripper[name] = tuple(gripper[name])
    own = (
        Gripper(**{n: _needed(gripper, "gripper", n) for n in _KEYS["gripper"]})
        if gripper
        else None
    )
    if not hand:
        return own
    site, turn = str(_needed(hand, "hand", "site")), float(hand.get("turn", 0.0))
    if "mjcf" in hand:
        if own is None:
            raise InvalidValueError("[gripper]", "none", "given for the file of [hand]")
        return Hand(mjcf=(folder / hand["mjcf"]).resolve(), site=site, turn=turn, gripper=own)
    return known_hand(str(_needed(hand, "hand", "name")), site, turn)


def _needed(table: Mapping[str, Any], name: str, key: str) -> Any:
    if key not in table:
        raise InvalidValueError(_title(name, key), "nothing", "given")
    return table[key]


def _title(name: str, key: str) -> str:
    """Return what messages call a key of a table."""
    return f"{key} of " + (f"[{name}]" if name else "the description")
