"""CSV files read strictly: every refusal is one line that names the file and the row."""

import csv
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from io import StringIO
from math import isfinite
from pathlib import Path

from omnivert.errors import DataError
from omnivert.formats.regular import content

NS_PER_S = 10**9
EARLIEST_S = Decimal(-(2**28))  # 8 years before any origin, and 136 after it; together they fit a stamp
LATEST_S = Decimal(2**32)


def refusal(place: str, because: str) -> DataError:
    """`place` names the file, and the row where there is one; the header is row 1."""
    return DataError("OV310", place, because, "omnivert explain OV310")


@dataclass(frozen=True, slots=True)
class Row:
    """One row under its column names."""

    place: str  # "frames.csv, row 7"
    fields: dict[str, str]  # of the columns that were asked for
    further: tuple[str, ...] = ()  # fields beyond the named columns

    def text(self, column: str) -> str:
        given = self.fields[column].strip()
        if not given:
            raise refusal(self.place, f"{column} is empty")
        return given

    def stamp_ns(self, column: str) -> int:
        """Seconds as nanoseconds, exact to the last digit: a float would lose some on a clock that counts from 1970."""
        given = self.text(column)
        try:
            seconds = Decimal(given)
        except InvalidOperation:
            raise refusal(self.place, f"{column} = {given[:40]!r} is no number") from None
        if not seconds.is_finite() or not EARLIEST_S <= seconds <= LATEST_S:
            raise refusal(self.place, f"{column} = {given[:40]!r} is no time in seconds")
        return int((seconds * NS_PER_S).to_integral_value())

    def number(self, column: str) -> float:
        given = self.text(column)
        try:
            value = float(given)
        except ValueError:
            raise refusal(self.place, f"{column} = {given[:40]!r} is no number") from None
        if not isfinite(value):
            raise refusal(self.place, f"{column} = {given[:40]!r} is no finite number")
        return value

    def integer(self, column: str) -> int:
        given = self.text(column)
        try:
            value = float(given) if len(given) < 40 else float("nan")
        except ValueError:
            raise refusal(self.place, f"{column} = {given[:40]!r} is no number") from None
        if not isfinite(value) or value != int(value) or abs(value) > 2**53:
            raise refusal(self.place, f"{column} = {given[:40]!r} is no whole number")
        return int(value)


def rows(path: Path, columns: tuple[str, ...], optional: tuple[str, ...] = ()) -> Iterator[Row]:
    """The rows of a CSV file whose header holds the columns, in any order and among others.

    optional  columns that are in `Row.fields` only where the header has them
    raises  DataError when the file is missing, is no text, lacks a column, or has a row of another length
    """
    for place, header, fields in _records(path):
        missing = [column for column in columns if column not in header]
        if missing:
            raise refusal(path.name, f"no column {missing[0]!r}; its header is {','.join(header)[:200]!r}")
        named = dict(zip(header, fields, strict=True))
        yield Row(place, {name: named[name] for name in (*columns, *optional) if name in named})


def wide_rows(path: Path, first: str) -> Iterator[Row]:
    """The rows of a CSV file with one named column and then as many numbers as there are."""
    for place, header, fields in _records(path):
        if header[0] != first:
            raise refusal(path.name, f"the first column is {header[0]!r} instead of {first!r}")
        yield Row(place, {first: fields[0]}, tuple(fields[1:]))


def _records(path: Path) -> Iterator[tuple[str, list[str], list[str]]]:
    """(place, header, fields) of every row that is not blank; at least one."""
    header: list[str] = []
    empty = True
    try:
        lines = StringIO(content(path).decode("utf-8-sig"), newline="")
        reader = csv.reader(lines, strict=True)
        for fields in reader:
            place = f"{path.name}, row {reader.line_num}"
            if not any(field.strip() for field in fields):
                continue
            if not header:
                header = [field.strip() for field in fields]
                twice = [name for name, times in Counter(header).items() if name and times > 1]
                if twice:
                    raise refusal(place, f"the header has the column {twice[0]!r} twice")
                continue
            if len(fields) != len(header):
                raise refusal(place, f"{len(fields)} fields where the header has {len(header)}")
            empty = False
            yield place, header, fields
    except FileNotFoundError:
        raise refusal(path.name, f"there is no such file in {path.parent}") from None
    except OSError as error:
        raise refusal(path.name, f"cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise refusal(path.name, "is not UTF-8 text") from error
    except csv.Error as error:
        raise refusal(path.name, f"is not CSV: {error}") from error
    if empty:
        raise refusal(path.name, "holds no rows" if header else "is empty")
