"""Texts on a picture that keep clear of each other and of its border."""

import math
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.pictures.palette import Colour
from omnivert.pictures.words import printable

Bgr = NDArray[np.uint8]
Place = tuple[float, float]  # x, y
Box = tuple[int, int, int, int]  # left, top, right, bottom

GROUND = (24, 20, 18)  # of the band
BACKING = 0.15  # what is left of the picture's brightness behind a text
MOST_ROWS = 8  # of one block of text
WEIGHT = 600  # semibold: thin strokes of small letters lose their colour


@dataclass(frozen=True, slots=True)
class _Text:
    """One row that has its place."""

    text: str
    x: int
    baseline: int
    color: Colour


class Labels:
    """What is to be written on one picture: places are given at once, the writing comes last, over all strokes.

    drawn  (H, W, 3) written into
    size   px, of the letters
    top    px, height of a band above the picture; nothing but its own row is placed there
    """

    def __init__(self, drawn: Bgr, size: float, top: int = 0) -> None:
        self._drawn = drawn
        self._font = cv2.FontFace("sans")
        self._size = max(round(size), 6)
        self._top = top
        self._pad = max(round(0.2 * size), 1)
        self._texts: list[_Text] = []
        self._taken = np.empty((0, 4), dtype=np.int64)

    @property
    def boxes(self) -> NDArray[np.int64]:
        """(N, 4) left, top, right, bottom of all that has its place; right and bottom lie outside."""
        return self._taken

    def extent(self, text: str) -> tuple[int, int]:
        """Width and height of the text with its backing, px."""
        return self._width(text) + 2 * self._pad, self._size + self._pad

    def place(self, text: str, color: Colour, middles: Iterable[Place]) -> Box | None:
        """Put the text at the first of these places where it lies on nothing else and inside the picture.

        returns  left, top, right, bottom; None when there is no room for it
        """
        width, height = self.extent(text)
        rows, columns = self._drawn.shape[:2]
        for x, y in middles:
            left, top = round(x - width / 2), round(y - height / 2)
            box = left, top, left + width, top + height
            inside = left >= 0 and top >= self._top and box[2] <= columns and box[3] <= rows
            if inside and not self._meets(box):
                self._taken = np.vstack([self._taken, box])
                baseline = top + round(0.5 * self._pad + 0.86 * self._size)
                self._texts.append(_Text(text, left + self._pad, baseline, color))
                return box
        return None

    def paragraph(self, texts: Iterable[str], color: Colour) -> None:
        """Texts below each other in the lower left corner, in as many rows as they need."""
        margin, height = self._size // 2, round(1.35 * self._size)
        rows, columns = self._drawn.shape[:2]
        wrapped = [row for text in texts for row in self._wrapped(printable(text), columns - 2 * margin)]
        most = max(min(MOST_ROWS, (rows - self._top - 2 * margin) // height), 1)
        if len(wrapped) > most:
            wrapped = [*wrapped[: most - 1], "…"]
        if not wrapped:
            return
        top = max(rows - len(wrapped) * height - 2 * margin, self._top)
        right = min(max(map(self._width, wrapped)) + 2 * margin, columns)
        self._taken = np.vstack([self._taken, (0, top, right, rows)])
        for row, text in enumerate(wrapped):
            self._texts.append(_Text(text, margin, top + margin + row * height + self._size, color))

    def band(self, left: str, right: str, left_color: Colour, right_color: Colour) -> None:
        """One row above the picture; the left text is cut where it has no room, the right one is left out."""
        margin, columns = self._size // 2, self._drawn.shape[1]
        left = self._cut(left, columns - 2 * margin)
        baseline = round(0.5 * self._top + 0.36 * self._size)
        self._texts.append(_Text(left, margin, baseline, left_color))
        start = columns - margin - self._width(right)
        if start > margin + self._width(left) + 2 * self._size:
            self._texts.append(_Text(right, start, baseline, right_color))

    def write(self) -> None:
        """All of it, each on its darkened backing."""
        self._drawn[: self._top] = GROUND
        for left, top, right, bottom in self._taken:
            behind = self._drawn[top:bottom, left:right]
            behind[:] = (behind * BACKING).astype(np.uint8)
        for text in self._texts:
            at = text.x, text.baseline
            cv2.putText(self._drawn, text.text, at, text.color, self._font, self._size, WEIGHT)

    def _meets(self, box: Box) -> bool:
        left, top, right, bottom = self._taken.T
        return bool(np.any((left < box[2]) & (right > box[0]) & (top < box[3]) & (bottom > box[1])))

    def _width(self, text: str) -> int:
        return math.ceil(cv2.getTextSize((0, 0), text, (0, 0), self._font, self._size, WEIGHT)[2]) if text else 0

    def _cut(self, text: str, room: int) -> str:
        if self._width(text) <= room:
            return text
        return next((cut for n in range(len(text), 0, -1) if self._width(cut := text[:n].rstrip() + "…") <= room), "")

    def _wrapped(self, text: str, room: int) -> list[str]:
        columns, rows = len(text), [text]
        while columns > 1 and any(self._width(row) > room for row in rows):
            columns = max(int(0.9 * columns), 1)
            rows = textwrap.wrap(text, columns)
        return rows
