"""A question and its answer: whether one is awaited, and what is counted when it does not come."""

from collections import Counter


class Exchange:
    """One at a time. Whoever has never answered since the port was opened is silent, and that is told elsewhere."""

    def __init__(self, refused: Counter[str]) -> None:
        self._refused = refused
        self._answers = False
        self.awaits = False

    def begin(self, heard: bool) -> None:
        """A question is asked; `heard` tells whether anything came to the one before."""
        if self.awaits and heard:
            self._refused["answer cut off"] += 1
        elif self.awaits and self._answers:
            self._refused["no answer"] += 1
        self.awaits = True

    def end(self) -> None:
        """The answer is complete, right or wrong."""
        self.awaits, self._answers = False, True

    def reset(self) -> None:
        self.awaits = self._answers = False
