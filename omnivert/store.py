"""Extrinsics in SQLite: all of them, durable when `put` returns."""

import fcntl
import json
import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote

import numpy as np

from omnivert.errors import DataError
from omnivert.messages import Extrinsics, Mount, State

APPLICATION_ID = 0x4F565254  # "OVRT": whose file it is
SCHEMA = 1
SCHEMA_1 = f"""
BEGIN IMMEDIATE;
CREATE TABLE IF NOT EXISTS extrinsics (
    entry       INTEGER PRIMARY KEY AUTOINCREMENT,
    recency     INTEGER NOT NULL UNIQUE,  -- order of the last put; below 0 of a playback
    saved_at    TEXT    NOT NULL,         -- ISO 8601, UTC
    robot       TEXT    NOT NULL,
    camera      TEXT    NOT NULL,
    stamp_ns    INTEGER NOT NULL,         -- of the sensor
    phi_rad     REAL    NOT NULL,
    rho_m       REAL    NOT NULL,
    psi_rad     REAL    NOT NULL,
    covariance  TEXT    NOT NULL,         -- JSON, 3 x 3, order phi, rho, psi
    state       TEXT    NOT NULL,
    frames      INTEGER NOT NULL,
    reasons     TEXT    NOT NULL,         -- JSON
    software    TEXT    NOT NULL,
    rig_digest  TEXT    NOT NULL
) STRICT;
CREATE INDEX IF NOT EXISTS by_camera ON extrinsics (robot, camera, recency);
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {SCHEMA};
COMMIT;
"""
COLUMNS = "robot, camera, stamp_ns, phi_rad, rho_m, psi_rad, covariance, state, frames, reasons, software, rig_digest"
SAME = " AND ".join(f"{column.strip()} = ?" for column in COLUMNS.split(","))
NEXT = "(SELECT max(coalesce(max(recency), 0), 0) + 1 FROM extrinsics)"
# What a playback gives comes behind all that the robot itself gave, and keeps its own order there.
NEXT_REPLAYED = f"(SELECT coalesce(max(recency), {-(2**62)}) + 1 FROM extrinsics WHERE recency < 0)"
Value = str | int | float


class StoreError(DataError):
    """The store cannot be read or written, and why; it may work again later."""


class _Damaged(sqlite3.DatabaseError):
    """Found by SQLite's own check."""

    sqlite_errorcode = sqlite3.SQLITE_CORRUPT


@dataclass(frozen=True, slots=True)
class Entry:
    """One stored mount."""

    entry: int
    saved_at: str  # ISO 8601, UTC, of the first time it was put
    extrinsics: Extrinsics
    replayed: bool = False  # from a playback, not from the robot itself


class Store:
    """One SQLite file (WAL, synchronous=FULL). Its methods may be called from several threads.

    writable   False reads only: nothing is created, moved or repaired
    locked_s   how long to wait for another program
    set_aside  where a file went that could not be read, else None
    raises     StoreError
    """

    def __init__(self, path: Path, *, writable: bool = True, locked_s: float = 2.0) -> None:
        self.path = path
        self.set_aside: Path | None = None
        self._writable = writable
        self._locked_s = locked_s
        self._one_at_a_time = threading.Lock()
        self._connection = self._opened()
        self._file = _identity(path)

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file; nothing is lost without it."""
        self._connection.close()

    def put(self, extrinsics: Extrinsics, replayed: bool = False) -> int:
        """Stores it and returns its number; when this returns, it survives a power loss.

        The very same extrinsics again keep their number, and are the latest again.
        replayed  they come from a playback: never the latest where the robot itself has given some
        raises    ValueError when a number in it is not finite; StoreError
        """
        mount = extrinsics.mount
        if not np.isfinite([mount.phi_rad, mount.rho_m, mount.psi_rad, *mount.covariance.ravel()]).all():
            raise ValueError("extrinsics with numbers that are not finite")
        values, following = _values(extrinsics), NEXT_REPLAYED if replayed else NEXT
        with self._one_at_a_time, self._troubles("be written"):
            self._check_in_place()
            with self._transaction() as cursor:
                known = cursor.execute(f"SELECT entry, recency FROM extrinsics WHERE {SAME}", values).fetchone()
                if known is None:
                    marks = ", ".join((following, "?", *("?" for _ in values)))
                    now = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
                    insert = f"INSERT INTO extrinsics (recency, saved_at, {COLUMNS}) VALUES ({marks})"
                    cursor.execute(insert, (now, *values))
                elif known[1] < 0 or not replayed:
                    cursor.execute(f"UPDATE extrinsics SET recency = {following} WHERE entry = ?", known[:1])
                entry = int(known[0] if known else cursor.lastrowid or 0)
            self._check_in_place()
        return entry

    def latest(self, robot: str, camera: str) -> Entry | None:
        """What was put last for this camera; of a playback only where the robot itself has given nothing."""
        found = self.history(robot, camera, limit=1)
        return found[0] if found else None

    def history(self, robot: str, camera: str, limit: int = 1000) -> list[Entry]:
        """What was put for this camera, newest first; what playbacks gave comes after what the robot gave."""
        return self._selected("WHERE robot = ? AND camera = ? ORDER BY recency DESC LIMIT ?", (robot, camera, limit))

    def entries(self) -> list[Entry]:
        """Everything in order of its number."""
        return self._selected("ORDER BY entry", ())

    def newest(self) -> list[Entry]:
        """The latest of each camera, in order of robot and camera."""
        last = "recency IN (SELECT max(recency) FROM extrinsics GROUP BY robot, camera)"
        return self._selected(f"WHERE {last} ORDER BY robot, camera", ())

    def _selected(self, which: str, values: tuple[Value, ...]) -> list[Entry]:
        with self._one_at_a_time, self._troubles("be read"):
            self._check_in_place()
            question = f"SELECT entry, saved_at, recency, {COLUMNS} FROM extrinsics {which}"
            return [_entry(row) for row in self._connection.execute(question, values).fetchall()]

    # The file ---------------------------------------------------------------------------------------------------

    def _opened(self) -> sqlite3.Connection:
        if not self._writable:
            if not self.path.is_file():
                raise StoreError("OV605", f"no store {self.path}", "nothing was saved there yet", "omnivert demo")
            with self._troubles("be opened"):
                try:
                    return self._connected("ro")
                except sqlite3.OperationalError:
                    if self.path.with_name(f"{self.path.name}-wal").exists():
                        raise
                    return self._connected("ro&immutable=1")  # the folder cannot be written, and nobody has it open
        if self.path.is_dir():
            help = "set storage.path to a file"
            raise StoreError("OV602", f"the store {self.path} cannot be opened", "it is a folder", help)
        if not self.path.parent.is_dir():
            because = f"there is no folder {self.path.parent}"
            raise StoreError(
                "OV602", f"the store {self.path} cannot be opened", because, f"mkdir {quote(str(self.path.parent))}"
            )
        with self._troubles("be opened"):
            with suppress(_Damaged):
                return self._connected()
            with _folder_handle(self.path.parent) as handle:
                fcntl.flock(handle, fcntl.LOCK_EX)  # one process at a time; the lock goes with the handle
                with suppress(_Damaged):  # another process may have put it right meanwhile
                    return self._connected()
                self.set_aside = _set_aside(self.path)
            return self._connected()

    def _connected(self, mode: str = "rwc") -> sqlite3.Connection:
        """A connection to a file that is whole and ours; a new file gets its table."""
        address = f"{self.path.absolute().as_uri()}?mode={mode}"
        connection = sqlite3.connect(
            address, uri=True, timeout=self._locked_s, isolation_level=None, check_same_thread=False
        )
        try:
            self._prepare(connection)
        except BaseException as error:
            connection.close()
            if isinstance(error, sqlite3.Error) and _is_corrupt(error):
                raise _Damaged(str(error)) from error
            raise
        return connection

    def _prepare(self, connection: sqlite3.Connection) -> None:
        whole = connection.execute("PRAGMA quick_check(1)").fetchone()[0]
        if whole != "ok":
            raise _Damaged(whole)
        self._check_ours(connection)
        if not self._writable:
            return
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        connection.executescript(SCHEMA_1)
        _sync_folder(self.path.parent)  # a new file's name is durable, too

    def _check_ours(self, connection: sqlite3.Connection) -> None:
        tables, schema, owner = (
            int(connection.execute(question).fetchone()[0])
            for question in ("SELECT count(*) FROM sqlite_master", "PRAGMA user_version", "PRAGMA application_id")
        )
        refused, help = f"the store {self.path} is not used", "set storage.path to another file"
        if not tables and not self._writable:
            raise StoreError("OV605", f"the store {self.path} is empty", "nothing was saved there yet")
        if tables and owner != APPLICATION_ID:
            raise StoreError("OV604", refused, "it is a data base of another program", help)
        if schema > SCHEMA:
            raise StoreError("OV604", refused, f"it has schema {schema}, this omnivert knows up to {SCHEMA}", help)

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Cursor]:
        cursor = self._connection.cursor()
        cursor.execute("BEGIN IMMEDIATE")
        try:
            yield cursor
            cursor.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                cursor.execute("ROLLBACK")
            raise

    @contextmanager
    def _troubles(self, doing: str) -> Iterator[None]:
        """SQLite's errors as ours."""
        try:
            yield
        except sqlite3.Error as error:
            raise self._trouble(error, doing) from error
        except OSError as error:
            raise StoreError("OV602", f"the store {self.path} cannot {doing}", str(error)) from error
        except ValueError as error:  # a row that none of our versions wrote
            raise StoreError(
                "OV603", f"the store {self.path} cannot {doing}", f"it is damaged ({_in_one_line(error)})"
            ) from error

    def _trouble(self, error: sqlite3.Error, doing: str) -> StoreError:
        what = f"the store {self.path} cannot {doing}"
        if _code(error) in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            because = f"another program has had it locked for {self._locked_s:g} s"
            return StoreError("OV601", what, because, f"fuser {quote(str(self.path))}   # shows who")
        if _is_corrupt(error):
            help = "omnivert up --config robot.toml   # sets it aside, begins a new one"
            return StoreError("OV603", what, f"it is damaged ({_in_one_line(error)})", help)
        return StoreError(
            "OV602", what, _in_one_line(error), "set storage.path to a file in a folder that you may write"
        )

    def _check_in_place(self) -> None:
        """Whether the name still leads to the file that is open: what goes into a removed file is lost."""
        if _identity(self.path) != self._file:
            raise StoreError("OV606", f"the store {self.path} was moved or removed", "while it was open")


def _values(extrinsics: Extrinsics) -> tuple[Value, ...]:
    """In the order of COLUMNS."""
    mount = extrinsics.mount
    covariance = json.dumps([[float(value) for value in row] for row in mount.covariance])
    reasons = json.dumps(list(extrinsics.reasons), ensure_ascii=False)
    return (
        *(extrinsics.robot, extrinsics.camera, extrinsics.stamp_ns),
        *(float(mount.phi_rad), float(mount.rho_m), float(mount.psi_rad), covariance),
        *(extrinsics.state.value, extrinsics.frames, reasons, extrinsics.software, extrinsics.rig_digest),
    )


def _entry(row: tuple[Value, ...]) -> Entry:
    """A row of entry, saved_at, recency, COLUMNS."""
    entry, saved_at, recency, robot, camera, *result = row
    stamp_ns, phi, rho, psi, covariance, state, frames, reasons, software, rig = result
    mount = Mount(float(phi), float(rho), float(psi), np.array(json.loads(str(covariance)), dtype=np.float64))
    said, why, made_by = State(str(state)), tuple(json.loads(str(reasons))), str(software)
    whole = Extrinsics(int(stamp_ns), str(robot), str(camera), mount, said, int(frames), why, made_by, str(rig))
    return Entry(int(entry), str(saved_at), whole, int(recency) < 0)


def _code(error: sqlite3.Error) -> int:
    """SQLite's primary result code; 0 when the error is not SQLite's own."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def _in_one_line(error: Exception) -> str:
    """What it says, without the headings of SQLite's own check."""
    lines = (line.strip() for line in str(error).splitlines())
    return "; ".join(line for line in lines if line and not line.startswith("***"))


def _is_corrupt(error: sqlite3.Error) -> bool:
    return _code(error) in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _set_aside(path: Path) -> Path:
    """Renames the file and its companions to a name that nothing has yet."""
    day = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    names = (path.with_name(f"{path.name}.damaged-{day}{more}") for more in ("", *(f"-{n}" for n in range(2, 1000))))
    aside = next(name for name in names if not name.exists())
    for companion in ("-wal", "-shm", ""):  # the file itself last: until then it is found damaged again
        with suppress(FileNotFoundError):
            path.with_name(path.name + companion).rename(aside.with_name(aside.name + companion))
    _sync_folder(path.parent)
    return aside


def _sync_folder(folder: Path) -> None:
    with _folder_handle(folder) as handle:
        os.fsync(handle)


@contextmanager
def _folder_handle(folder: Path) -> Iterator[int]:
    handle = os.open(folder, os.O_RDONLY)
    try:
        yield handle
    finally:
        os.close(handle)
