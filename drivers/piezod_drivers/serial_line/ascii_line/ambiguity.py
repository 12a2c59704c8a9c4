"""The choices that a regular expression leaves, read from its text.

Which characters may follow which is Glushkov's automaton: every character, class or `.` of the
expression is a place, and from each place it is known which places may come next. Where two of
them match the same character there is a clash: whoever matches has to try both.
"""

import re
from itertools import combinations
from typing import Final, NamedTuple

_OTHER: Final = 256
_ALPHABET: Final = (*map(chr, range(_OTHER)), "\u2603")  # the last stands for all others
_PLAIN_ESCAPES: Final = frozenset("dDsSwWtnrfvx")


class Clash(NamedTuple):
    """Two places that may come next and match the same character.

    Attributes:
        first: The one that comes first in the expression.
        texts: Both, as they are written.
        repeated: Whether a repeated group holds both, so that the choice comes again and again.
    """

    first: int
    texts: tuple[str, str]
    repeated: bool


class _Part(NamedTuple):
    nothing: bool  # whether it may match nothing
    first: frozenset[int]
    last: frozenset[int]


_NOTHING: Final = _Part(True, frozenset(), frozenset())


def clashes_of(pattern: str) -> list[Clash]:
    """Find the choices that a regular expression leaves; Python's `re` must have compiled it.

    Raises:
        ValueError: If it has what cannot be judged: the error says what, and what to do.
    """
    return _Reader(pattern).clashes()


class _Reader:
    def __init__(self, pattern: str) -> None:
        self._pattern, self._at = pattern, 0
        self._texts: list[str] = []
        self._chars: list[frozenset[int]] = []
        self._follow: list[set[int]] = []
        self._groups: list[set[int]] = []
        self._n_groups = 0

    def clashes(self) -> list[Clash]:
        whole = self._alternatives()
        found = set()
        for nexts in [whole.first, *self._follow]:
            for first, second in combinations(sorted(nexts), 2):
                if self._chars[first] & self._chars[second]:
                    texts = self._texts[first], self._texts[second]
                    repeated = bool(self._groups[first] & self._groups[second])
                    found.add(Clash(first, texts, repeated))
        return sorted(found)

    def _next(self, length: int = 1) -> str:
        return self._pattern[self._at : self._at + length]

    def _alternatives(self) -> _Part:
        part = self._sequence()
        while self._next() == "|":
            self._at += 1
            other = self._sequence()
            part = _Part(
                part.nothing or other.nothing, part.first | other.first, part.last | other.last
            )
        return part

    def _sequence(self) -> _Part:
        part = _NOTHING
        while self._next() not in {"", "|", ")"}:
            part = self._joined(part, self._element())
        return part

    def _joined(self, before: _Part, after: _Part) -> _Part:
        for place in before.last:
            self._follow[place] |= after.first
        return _Part(
            before.nothing and after.nothing,
            before.first | after.first if before.nothing else before.first,
            before.last | after.last if after.nothing else after.last,
        )

    def _element(self) -> _Part:
        begin = len(self._texts)
        grouped = self._next() == "("
        part = self._group() if grouped else self._place()
        low, high = self._quantifier()
        if high > 1 and (grouped or low != high):
            part = self._repeated(part, range(begin, len(self._texts)), grouped)
        return part._replace(nothing=part.nothing or low == 0)

    def _group(self) -> _Part:
        opening = re.compile(r"\((?:\?:|\?P<\w+>|(?!\?))").match(self._pattern, self._at)
        if opening is None:
            raise ValueError(
                f"{self._next(4)}… is not allowed: of groups only (…), (?:…), (?P<…>…)"
            )
        self._at = opening.end()
        part = self._alternatives()
        self._at += 1  # the closing parenthesis
        return part

    def _place(self) -> _Part:
        found = re.compile(r"\[\^?\]?(?:\\.|[^\]\\])*\]|\\x..|\\.|.", re.DOTALL).match(
            self._pattern, self._at
        )
        assert found is not None  # noqa: S101 - the expression has been compiled, and goes on here
        text = found[0]
        if text in "^${" or (
            text[0] == "\\" and text[1].isalnum() and text[1] not in _PLAIN_ESCAPES
        ):
            remedy = "an answer is matched as a whole, characters stand for themselves"
            raise ValueError(f"{text} is not allowed: {remedy}")
        self._at = found.end()
        chars = re.compile(text, re.ASCII)
        self._texts.append(text)
        self._chars.append(
            frozenset(code for code, char in enumerate(_ALPHABET) if chars.fullmatch(char))
        )
        self._follow.append(set())
        self._groups.append(set())
        return _Part(False, *[frozenset({len(self._texts) - 1})] * 2)

    def _quantifier(self) -> tuple[int, float]:
        found = re.compile(r"([*+?]|\{(\d*)(,?)(\d*)\})([?+]?)").match(self._pattern, self._at)
        if found is None:
            return 1, 1
        self._at = found.end()
        if found[5] == "+":
            raise ValueError(f"{found[0]} is not allowed: leave out the second +")
        if found[2] is None:
            return {"*": (0, float("inf")), "+": (1, float("inf")), "?": (0, 1)}[found[1]]
        low = int(found[2] or 0)
        return low, (float(found[4] or "inf") if found[3] else low)

    def _repeated(self, part: _Part, places: range, grouped: bool) -> _Part:
        if grouped and part.nothing:
            raise ValueError("a group that may match nothing is repeated: let it match something")
        for place in part.last:
            if part.first & self._follow[place]:
                what = f"{self._texts[place]} is repeated, and so is the group around it"
                raise ValueError(f"{what}: leave out one of the two")
            self._follow[place] |= part.first
        if grouped:
            self._n_groups += 1
            for place in places:
                self._groups[place].add(self._n_groups)
        return part
