"""Contender: a policy as it is named in an evaluation."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import get_args

from robo47_qp.errors import InvalidValueError, UnknownNameError
from robo47_qp.evaluation.policy import CLASSICAL, PolicyReference
from robo47_qp.options import IkName

IK_NAMES: tuple[IkName, ...] = get_args(IkName)
NAMES = (CLASSICAL, *(f"{CLASSICAL}:{ik}" for ik in IK_NAMES))
"""Names of the classical stack; plain, it takes the IK of --ik."""
_LONGEST = 60
"""Characters of a label; the end of a long name tells more than its beginning."""


@dataclass(frozen=True, kw_only=True)
class Contender:
    """A policy by its name: the classical stack with an IK, or one from elsewhere."""

    name: str
    """As it was asked for."""
    ik: IkName | None
    """Inverse kinematics of the classical stack; None for a policy from elsewhere."""

    @classmethod
    def of(cls, name: str, ik: IkName) -> "Contender":
        """The policy of a name; `ik` is for a classical stack that names none.

        Raises:
            UnknownNameError: It is a classical stack with an IK that nobody knows.
        """
        if name == CLASSICAL:
            return cls(name=name, ik=ik)
        stack, _, named = name.partition(":")
        if stack != CLASSICAL:
            return cls(name=name, ik=None)
        if named not in IK_NAMES:
            raise UnknownNameError("policy", name, (*NAMES, "module:Class", "file.py:Class"))
        return cls(name=name, ik=named)

    @property
    def reference(self) -> PolicyReference | None:
        """Where it is found; None for the classical stack."""
        return None if self.ik is not None else PolicyReference(text=self.name).absolute

    @property
    def identity(self) -> str:
        """What two names of the same policy share."""
        return f"{CLASSICAL}:{self.ik}" if self.reference is None else self.reference.text


def check_different(contenders: Sequence[Contender]) -> None:
    """Check that no policy is there twice, under whatever names.

    Raises:
        InvalidValueError: One is.
    """
    seen: dict[str, str] = {}
    for contender in contenders:
        name = contender.name
        if contender.identity in seen:
            found = f"{seen[contender.identity]} and {name}, which are one and the same"
            raise InvalidValueError("--policy", found, "another one each time")
        seen[contender.identity] = name


def labels(contenders: Sequence[Contender]) -> list[str]:
    """A part of a file name for each: different ones, also where case does not count."""
    plain = [re.sub(r"[^A-Za-z0-9_]+", "-", c.name)[-_LONGEST:].strip("-") for c in contenders]
    lower = [label.lower() for label in plain]
    return [
        label if lower.count(label.lower()) == 1 else f"{label}-{_digest(contender.name)}"
        for label, contender in zip(plain, contenders, strict=True)
    ]


def _digest(name: str) -> str:
    return sha256(name.encode()).hexdigest()[:8]
