"""Array types, and the rules that values from outside are checked against."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from math import inf, isfinite
from operator import index
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Literal,
    TypeAlias,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np
from numpy.typing import ArrayLike, NDArray

from robo47_qp.errors import InvalidValueError

if TYPE_CHECKING:  # the process of a policy starts without mink, which takes longest
    from mink import SE3

Vector: TypeAlias = NDArray[np.float64]
Matrix: TypeAlias = NDArray[np.float64]


class Rule:
    """What a value must be; `str` says it in the words of a message."""

    def _accepts(self, value: Any) -> bool:
        raise NotImplementedError

    def check(self, name: str, value: Any) -> None:
        """Check a value that messages call `name`.

        Raises:
            InvalidValueError: The rule does not accept the value.
        """
        if not self._accepts(value):
            found = repr(value) if isinstance(value, str) else value
            raise InvalidValueError(name, found, str(self))


@dataclass(frozen=True, kw_only=True)
class Range(Rule):
    """A rule for numbers: the range they lie in. Infinity counts only where `infinite` is set."""

    above: float = -inf
    at_least: float = -inf
    below: float = inf
    at_most: float = inf
    whole: bool = False
    infinite: bool = False
    single: bool = False
    """Whether only one number is accepted, where otherwise arrays of them are, too."""

    def _accepts(self, value: Any) -> bool:
        try:
            if self.single and np.ndim(value):
                return False
            given = np.ravel(index(value) if self.whole else value)
            numbers = given.astype(float).tolist()
        except (TypeError, ValueError, OverflowError):
            return False
        # A text of digits would be converted, and stay a text.
        return given.dtype.kind not in "US" and all(map(self._contains, numbers))

    def _contains(self, x: float) -> bool:
        if not (self.above < x and self.at_least <= x <= self.at_most):
            return False
        return x < self.below or self.infinite

    def __str__(self) -> str:
        bounded = min(self.below, self.at_most) < inf
        if not bounded and self.above == self.at_least == -inf:
            return "a finite number"
        lower = f"at least {self.at_least:g}" if bounded else f"{self.at_least:g} or more"
        words = [f"above {self.above:g}" if self.above > -inf else lower]
        if bounded:
            words += [f"below {self.below:g}" if self.below < inf else f"at most {self.at_most:g}"]
        elif not (self.whole or self.infinite):
            words += ["finite"]
        return ("a whole number, " if self.whole else "") + " and ".join(words)


@dataclass(frozen=True, kw_only=True)
class Ends(Range):
    """A rule for a `Span`: the range that the number, or both ends, lie in."""

    def _accepts(self, value: Any) -> bool:
        given = np.ravel(value).tolist()
        return super()._accepts(value) and len(given) in (1, 2) and given == sorted(given)

    def __str__(self) -> str:
        return f"{super().__str__()}: one number, or two in rising order"


@dataclass(frozen=True)
class Numbers(Rule):
    """A rule for sequences: how many numbers they have, and the range of each.

    `tuple[float, float]` stands for it, with finite numbers.
    """

    count: int
    each: Range = Range()

    def _accepts(self, value: Any) -> bool:
        try:
            given = np.asarray(value)
        except ValueError:
            return False
        return given.shape == (self.count,) and self.each._accepts(given)

    def __str__(self) -> str:
        count = {2: "two", 3: "three"}.get(self.count, str(self.count))
        if self.each == Range():
            return f"{count} finite numbers"
        return f"{count} numbers, each {self.each}"


@dataclass(frozen=True)
class Suffix(Rule):
    """A rule for files: the suffix of their names."""

    suffix: str

    def _accepts(self, value: Path) -> bool:
        return value.suffix == self.suffix

    def __str__(self) -> str:
        return f"a file that ends with {self.suffix}"


@dataclass(frozen=True)
class OneOf(Rule):
    """A rule for names: those that are known. `Literal` stands for it."""

    names: tuple[object, ...]

    def _accepts(self, value: object) -> bool:
        return value in self.names

    def __str__(self) -> str:
        return " or ".join(map(repr, self.names))


@dataclass(frozen=True)
class Kind(Rule):
    """A rule for members of an Enum and instances of a `Checked`; an annotation stands for it."""

    kinds: tuple[type, ...]
    many: bool = False
    """Whether a sequence of them is meant."""

    @classmethod
    def of(cls, hint: object) -> "Kind | None":
        """Return the rule that an annotation stands for; None where it has other types, too."""
        if get_origin(hint) in (Sequence, tuple) and set(get_args(hint)[1:]) <= {...}:
            each = cls.of(get_args(hint)[0])
            return None if each is None else cls(each.kinds, many=True)
        kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
        ours = (Enum, Checked, NoneType)
        known = all(isinstance(kind, type) and issubclass(kind, ours) for kind in kinds)
        return cls(kinds) if known else None

    def _accepts(self, value: object) -> bool:
        if not self.many:
            return isinstance(value, self.kinds)
        return isinstance(value, Sequence) and all(isinstance(one, self.kinds) for one in value)

    def __str__(self) -> str:
        one = " or ".join(name for kind in self.kinds for name in _names(kind))
        return f"a sequence, each {one}" if self.many else one


def _names(kind: type) -> list[str]:
    """Return what messages call the values of a type."""
    if issubclass(kind, Enum):
        return [str(member) for member in kind]
    return ["None" if kind is NoneType else f"a {kind.__name__}"]


@dataclass(frozen=True)
class Size:
    """A rule for vectors: how many finite numbers they have. The field gets a frozen copy."""

    size: int
    unit: bool = False
    """Whether its length has to be 1."""


Positive: TypeAlias = Annotated[float, Range(above=0.0)]
NotNegative: TypeAlias = Annotated[float, Range(at_least=0.0)]
Longest: TypeAlias = Annotated[float, Range(above=0.0, infinite=True)]
"""A bound that may be infinite: none."""
Ratio: TypeAlias = Annotated[float, Range(above=0.0, at_most=1.0)]
Count: TypeAlias = Annotated[int, Range(at_least=1, whole=True)]
CountOrZero: TypeAlias = Annotated[int, Range(at_least=0, whole=True)]
Span: TypeAlias = float | tuple[float, float]
"""A number, or the two ends of a range."""


def ends(span: Span) -> tuple[float, float]:
    """Return both ends of a span; they are equal if it is a number."""
    low, *high = np.ravel(span).tolist()
    return low, high[0] if high else low


class Checked:
    """A dataclass whose annotations state the rules that its values are checked against.

    `mass: Positive` or `margin: Annotated[float, Range(above=0.0, below=0.5)]`; where a field
    is `Positive | None`, None passes. A plain `float`, and each of a `tuple[float, float]`, must be
    a finite number, and a plain `str` or `bool` one of these. An Enum, another such dataclass, or
    a sequence of them stands for its members and instances alone.
    """

    def __post_init__(self) -> None:
        """Check every field, and freeze those of a `Size`.

        Raises:
            InvalidValueError: A value breaks a rule of its field.
        """
        for field, rule, others in self._rules():
            value, label = getattr(self, field), self._label(field)
            if isinstance(value, others):
                continue
            if isinstance(rule, Size):
                object.__setattr__(self, field, frozen_vector(label, value, rule.size))
                if rule.unit:
                    check_unit(label, getattr(self, field))
            else:
                rule.check(label, value)

    def _label(self, field: str) -> str:
        """Return what messages call a field."""
        return field

    @classmethod
    @cache
    def _rules(cls) -> list[tuple[str, Rule | Size, tuple[type, ...]]]:
        """Return fields with their rules, and the types that pass: None, what checks itself."""
        rules: list[tuple[str, Rule | Size, tuple[type, ...]]] = []
        for field, hint in get_type_hints(cls, include_extras=True).items():
            plain = Kind.of(hint) or _plain(hint)
            if plain is not None:
                rules.append((field, plain, ()))
                continue
            own = any(isinstance(one, Rule | Size) for one in getattr(hint, "__metadata__", ()))
            inner = hint.__origin__ if get_origin(hint) is Annotated and not own else hint
            choices = get_args(inner) if get_origin(inner) in (Union, UnionType) else (hint,)
            others = tuple(
                one
                for one in choices
                if one is NoneType or (isinstance(one, type) and issubclass(one, Checked))
            )
            for choice in choices:
                stated = getattr(choice, "__metadata__", ())
                if get_origin(choice) is Literal:
                    stated = (OneOf(get_args(choice)),)
                number = get_origin(choice) is Annotated and choice.__origin__ in (int, float)
                for rule in stated:
                    if isinstance(rule, Range) and number:
                        rules.append((field, replace(rule, single=True), others))
                    elif isinstance(rule, Rule | Size):
                        rules.append((field, rule, others))
        return rules


def _plain(hint: Any) -> Rule | None:
    """Return the rule of plain numbers and texts; None for anything else."""
    each = get_args(hint)
    if get_origin(hint) is tuple and set(each) == {float}:
        return Numbers(len(each))
    if hint in (str, bool):
        return Kind((hint,))
    return Range() if hint is float else None


class CheckedOptions(Checked):
    """A dataclass of options of the command line: messages name the option."""

    def _label(self, field: str) -> str:
        return f"--{field.replace('_', '-')}"


def check_once(options: type, arguments: Sequence[str]) -> None:
    """Check that no option of several values is given twice: those of the first would be dropped.

    Args:
        options: Dataclass of the options; those of several values are tuples.
        arguments: The command line.

    Raises:
        InvalidValueError: One is.
    """
    given = [word.partition("=")[0].replace("_", "-") for word in arguments]
    for field, kind in get_type_hints(options).items():
        name = f"--{field.replace('_', '-')}"
        if get_origin(kind) is tuple and given.count(name) > 1:
            expected = "given once, with all its values behind it"
            raise InvalidValueError(name, f"{given.count(name)} of them", expected)


def read_number(kind: type[int | float] | None, word: str) -> int | float | str:
    """Return the number that a word is; what is none stays, and is left to the checks."""
    if kind is None:
        return word
    try:
        return kind(word)
    except ValueError:
        return word


def checked_vector(name: str, value: ArrayLike, size: int) -> Vector:
    """Copy `value` into a new float vector of shape (size,).

    Raises:
        InvalidValueError: Wrong shape, not a number, NaN or infinite.
    """
    expected = f"a vector of {size} finite numbers"
    try:
        vector = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidValueError(name, repr(value), expected) from error
    if vector.shape != (size,):
        raise InvalidValueError(name, f"shape {vector.shape}", expected)
    if not all(map(isfinite, vector.tolist())):
        raise InvalidValueError(name, vector.tolist(), expected)
    return vector


def contiguous(name: str, values: ArrayLike, *shape: int | None) -> NDArray[np.float64]:
    """Return numbers of a shape as C code reads them; sizes of None may be any.

    Raises:
        InvalidValueError: They have another shape.
    """
    found: NDArray[np.float64] = np.ascontiguousarray(values, dtype=np.float64)
    if found.ndim != len(shape) or any(
        size not in (None, own) for size, own in zip(shape, found.shape, strict=True)
    ):
        sizes = ", ".join("any" if size is None else str(size) for size in shape)
        raise InvalidValueError(name, f"shape {found.shape}", f"of shape ({sizes})")
    return found


def frozen_vector(name: str, value: ArrayLike, size: int) -> Vector:
    """Like `checked_vector`, and the result cannot be written to."""
    vector = checked_vector(name, value, size)
    vector.setflags(write=False)
    return vector


def frozen_list(name: str, given: Any) -> tuple[Any, ...]:
    """Return what is in a list, as a tuple.

    Raises:
        InvalidValueError: It is a text, or no list at all.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InvalidValueError(name, repr(given), "a list")
    return tuple(given)


def check_unit(name: str, direction: Vector) -> None:
    """Check that a direction has the length 1.

    Raises:
        InvalidValueError: It has another.
    """
    if abs(np.linalg.norm(direction) - 1.0) > 1e-6:
        raise InvalidValueError(name, direction.tolist(), "of length 1")


def check_pose(name: str, pose: "SE3") -> None:
    """Check that a pose is finite and has a unit quaternion.

    Raises:
        InvalidValueError: It has NaN, or its quaternion is not of length 1.
    """
    numbers = checked_vector(name, pose.wxyz_xyz, 7)
    if abs(np.linalg.norm(numbers[:4]) - 1.0) > 1e-6:
        raise InvalidValueError(name, numbers[:4].tolist(), "a pose with a unit quaternion")
