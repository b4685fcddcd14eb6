"""CSV tables whose rows are by `index` of the frames, such as the truth of a recording: parts of them, and joined."""

from collections.abc import Sequence

Rows = list[tuple[int, list[str]]]  # index of the frame, fields


def part_of(table: bytes, first: int, count: int) -> bytes:
    """The rows of some frames, counted from 0 again; the table as it is where it goes by something else."""
    read = _read(table)
    if read is None:
        return table
    header, column, rows = read
    kept = [(index - first, fields) for index, fields in rows if 0 <= index - first < count]
    return _written(header, column, kept)


def joined(tables: Sequence[tuple[int, bytes]]) -> bytes | None:
    """Tables of frames that follow each other as one; None where they are not tables by frame of the same columns.

    tables  (number of frames before, the table)
    """
    header, column, all_rows = "", 0, Rows()
    *earlier, last = tables
    whole = [(first, table if table.endswith(b"\n") else table + b"\n") for first, table in earlier]
    for first, table in (*whole, last):
        read = _read(table)
        if read is None or (header and read[0].strip() != header.strip()):
            return None
        own, column, rows = read
        header = header or own
        all_rows += [(index + first, fields) for index, fields in rows]
    return _written(header, column, all_rows)


def _read(table: bytes) -> tuple[str, int, Rows] | None:
    """Header, its column of the index, rows; None for another kind of table."""
    header, *lines = table.decode("utf-8-sig", errors="surrogateescape").splitlines(keepends=True) or [""]
    columns = [name.strip() for name in header.split(",")]
    if "index" not in columns:
        return None
    column, rows = columns.index("index"), Rows()
    for line in lines:
        fields = line.split(",")
        try:
            rows.append((int(fields[column]), fields))
        except (ValueError, IndexError):
            return None
    return header, column, rows


def _written(header: str, column: int, rows: Rows) -> bytes:
    lines = [header]
    for index, fields in rows:
        before = fields[column]
        renumbered = str(index) + before[len(before.rstrip()) :]
        lines.append(",".join([*fields[:column], renumbered, *fields[column + 1 :]]))
    return "".join(lines).encode(errors="surrogateescape")
