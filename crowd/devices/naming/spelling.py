"""Words of names as people type them, and correction of typing errors."""

import re
from collections import Counter
from collections.abc import Iterable
from functools import cached_property

WORD = re.compile(r"[^\W_]+\+*")
# Shorter words and words with digits are not corrected: "A5", "SM-G920X".
LEAST_CORRECTED = 4
LEAST_INSIDE = 3  # letters that may match in the middle of a word


def words(text: str) -> list[str]:
    """The words of `text` in lower case: letters, digits and a closing '+'. 'SM-G920F' is two words."""
    return WORD.findall(text.casefold())


def begins_or_holds(word: str, part: str) -> bool:
    """Whether `word` begins with `part`, or contains it and `part` is not too short."""
    return word.startswith(part) or (len(part) >= LEAST_INSIDE and part in word)


def is_one_edit_away(typed: str, word: str) -> bool:
    """Whether `typed` becomes `word` by inserting, deleting or changing a letter, or by swapping two."""
    if abs(len(typed) - len(word)) > 1 or typed == word:
        return False
    same = next((i for i, (a, b) in enumerate(zip(typed, word, strict=False)) if a != b), None)
    if same is None:
        return True
    rest, other = typed[same:], word[same:]
    return (
        rest[1:] == other[1:]
        or rest[1:] == other
        or rest == other[1:]
        or (rest[:2] == other[1::-1] and rest[2:] == other[2:])
    )


class Vocabulary:
    """The words of names, with their frequencies."""

    def __init__(self, texts: Iterable[str]) -> None:
        self._counts = Counter(word for text in texts for word in words(text))

    @cached_property
    def _letters_only(self) -> list[tuple[str, int]]:
        """The words that can be corrections, most frequent first."""
        return [(word, count) for word, count in self._counts.most_common() if word.isalpha()]

    def knows(self, typed: str) -> bool:
        """Whether a word begins with `typed`, or contains it."""
        return typed in self._counts or any(begins_or_holds(word, typed) for word in self._counts)

    def correct(self, typed: str) -> str:
        """The most frequent word, or beginning of a word, that is one edit away from `typed`.

        `typed` itself if it is known, too short, has a digit, or has no correction.
        """
        if len(typed) < LEAST_CORRECTED or not typed.isalpha() or self.knows(typed):
            return typed
        whole = [word for word, _ in self._letters_only if is_one_edit_away(typed, word)]
        if whole:
            return whole[0]
        size = len(typed)
        return next(
            (
                word
                for word, _ in self._letters_only
                if any(is_one_edit_away(typed, word[:end]) for end in (size, size + 1) if end <= len(word))
            ),
            typed,
        )
