"""Finds ambiguities in a regular expression, from its text.

Glushkov's automaton states which characters may follow which. Every character, class or `.` of the
expression is a position, and each position has a set of positions that may come next. If two of
these match the same character, the expression is ambiguous there: the engine has to try both.
"""

import re
from itertools import combinations
from typing import Final, NamedTuple

_OTHER: Final = 256
_ALPHABET: Final = (*map(chr, range(_OTHER)), "\u2603")  # the last stands for all others
_PLAIN_ESCAPES: Final = frozenset("dDsSwWtnrfvx")


class Ambiguity(NamedTuple):
    """Two positions that may come next and match the same character."""

    first: int  #: The position that comes first in the expression.
    texts: tuple[str, str]  #: The text of both positions.
    repeated: bool  #: Whether a repeated group contains both, so that the choice recurs.


class _Part(NamedTuple):
    nothing: bool  # whether it may match the empty text
    first: frozenset[int]
    last: frozenset[int]


_NOTHING: Final = _Part(True, frozenset(), frozenset())


def find_ambiguities(pattern: str) -> list[Ambiguity]:
    """Return the ambiguities of a regular expression that Python's `re` has compiled.

    Raises:
        ValueError: If it has an unsupported construct; the text has the remedy.
    """
    return _Reader(pattern).ambiguities()


class _Reader:
    def __init__(self, pattern: str) -> None:
        self._pattern, self._index = pattern, 0
        self._texts: list[str] = []
        self._chars: list[frozenset[int]] = []
        self._follow: list[set[int]] = []
        self._groups: list[set[int]] = []
        self._n_groups = 0

    def ambiguities(self) -> list[Ambiguity]:
        whole = self._alternatives()
        found = set()
        # Any two positions that may be next compete for the next character.
        for nexts in [whole.first, *self._follow]:
            for first, second in combinations(sorted(nexts), 2):
                if self._chars[first] & self._chars[second]:
                    texts = self._texts[first], self._texts[second]
                    repeated = bool(self._groups[first] & self._groups[second])
                    found.add(Ambiguity(first, texts, repeated))
        return sorted(found)

    def _peek(self, length: int = 1) -> str:
        return self._pattern[self._index : self._index + length]

    def _alternatives(self) -> _Part:
        part = self._sequence()
        while self._peek() == "|":
            self._index += 1
            other = self._sequence()
            part = _Part(
                part.nothing or other.nothing, part.first | other.first, part.last | other.last
            )
        return part

    def _sequence(self) -> _Part:
        part = _NOTHING
        while self._peek() not in {"", "|", ")"}:
            part = self._joined(part, self._element())
        return part

    def _joined(self, before: _Part, after: _Part) -> _Part:
        # What may end the first part may be followed by what may begin the second.
        for place in before.last:
            self._follow[place] |= after.first
        return _Part(
            before.nothing and after.nothing,
            # A part that may be empty lets its neighbour begin or end the sequence.
            before.first | after.first if before.nothing else before.first,
            before.last | after.last if after.nothing else after.last,
        )

    def _element(self) -> _Part:
        begin = len(self._texts)
        grouped = self._peek() == "("
        part = self._group() if grouped else self._place()
        low, high = self._quantifier()
        # x{3} leaves no choice: it is as good as xxx.
        if high > 1 and (grouped or low != high):
            part = self._repeated(part, range(begin, len(self._texts)), grouped)
        return part._replace(nothing=part.nothing or low == 0)

    def _group(self) -> _Part:
        # Groups without back-references, look-around or flags: only these have a set of next
        # positions.
        opening = re.compile(r"\((?:\?:|\?P<\w+>|(?!\?))").match(self._pattern, self._index)
        if opening is None:
            raise ValueError(
                f"{self._peek(4)}… is not allowed: the only groups are (…), (?:…), (?P<…>…)"
            )
        self._index = opening.end()
        part = self._alternatives()
        self._index += 1  # the closing parenthesis
        return part

    def _place(self) -> _Part:
        found = re.compile(r"\[\^?\]?(?:\\.|[^\]\\])*\]|\\x..|\\.|.", re.DOTALL).match(
            self._pattern, self._index
        )
        assert found is not None  # noqa: S101 - `re` has compiled the expression
        text = found[0]
        if text in "^${" or (
            text[0] == "\\" and text[1].isalnum() and text[1] not in _PLAIN_ESCAPES
        ):
            remedy = "a reply is matched as a whole, and characters stand for themselves"
            raise ValueError(f"{text} is not allowed: {remedy}")
        self._index = found.end()
        # `re` itself decides which characters a class matches.
        chars = re.compile(text, re.ASCII)
        self._texts.append(text)
        self._chars.append(
            frozenset(code for code, char in enumerate(_ALPHABET) if chars.fullmatch(char))
        )
        self._follow.append(set())
        self._groups.append(set())
        return _Part(False, *[frozenset({len(self._texts) - 1})] * 2)

    def _quantifier(self) -> tuple[int, float]:
        found = re.compile(r"([*+?]|\{(\d*)(,?)(\d*)\})([?+]?)").match(self._pattern, self._index)
        if found is None:
            return 1, 1
        self._index = found.end()
        if found[5] == "+":
            raise ValueError(f"{found[0]} is not allowed: leave out the second +")
        if found[2] is None:
            return {"*": (0, float("inf")), "+": (1, float("inf")), "?": (0, 1)}[found[1]]
        low = int(found[2] or 0)
        return low, (float(found[4] or "inf") if found[3] else low)

    def _repeated(self, part: _Part, places: range, grouped: bool) -> _Part:
        # Then the engine could repeat the group without end.
        if grouped and part.nothing:
            raise ValueError("a repeated group may match the empty text: let it match a character")
        for place in part.last:
            # The inner repetition and the outer one lead to the same position: the number of ways
            # grows exponentially with the length of the text.
            if part.first & self._follow[place]:
                what = f"{self._texts[place]} is repeated, and so is the group around it"
                raise ValueError(f"{what}: leave out one repetition")
            self._follow[place] |= part.first
        if grouped:
            self._n_groups += 1
            for place in places:
                self._groups[place].add(self._n_groups)
        return part
