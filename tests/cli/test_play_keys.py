"""A playback at a real terminal: it stands still, steps frame by frame, goes on and ends as the keys say."""

import fcntl
import io
import os
import pty
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest
from rich.console import Console

from omnivert.cli import say
from omnivert.cli.keys import keys
from omnivert.cli.recordings.followed import followed_from_outside
from omnivert.config import parsed
from omnivert.messages import Frame, Playback
from omnivert.wire.bus import Bus, Received, Router
from omnivert.wire.channels import PLAYBACK
from omnivert.wire.recording import Recording

OMNIVERT = (sys.executable, "-c", "from omnivert.cli import main; main()")
DEADLINE_S = 60.0


class Terminal:
    """A command at a terminal of its own, and all that it shows there."""

    def __init__(self, process: "subprocess.Popen[bytes]", ours: int) -> None:
        self.process = process
        self._ours = ours
        self._shown = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def type(self, key: bytes) -> None:
        os.write(self._ours, key)

    def await_shown(self, text: str, again: bytes = b"") -> None:
        """Waits until it has shown this; types `again` meanwhile."""
        deadline = time.monotonic() + DEADLINE_S
        while text.encode() not in self._shown:
            assert time.monotonic() < deadline, self._shown
            if again:
                self.type(again)
            self._reader.join(0.05)

    def settings(self) -> list[object]:
        return termios.tcgetattr(self._ours)

    def ended(self) -> tuple[int, str]:
        code = self.process.wait(DEADLINE_S)
        return code, self._shown.decode(errors="replace")

    def _read(self) -> None:
        while True:
            try:
                self._shown += os.read(self._ours, 4096)
            except OSError:
                return


@contextmanager
def at_terminal(*arguments: str) -> Iterator[Terminal]:
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*OMNIVERT, *arguments],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm"},
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    )
    try:
        yield Terminal(process, ours)
    finally:
        process.kill()
        process.wait()
        os.close(theirs)
        os.close(ours)


def standing(heard: Iterator[Received | None]) -> Playback:
    """Where the playback stands, once it has said so three times."""
    last: list[Playback] = []
    for received in heard:
        assert received is not None, "nothing was said"
        assert isinstance(received.message, Playback)
        last = [*last[-2:], received.message]
        if len(last) == 3 and last[0].played == last[2].played:
            return last[2]
    raise AssertionError("the bus ended")


def running(heard: Iterator[Received | None], beyond: int) -> None:
    """Until more than so many messages have been played."""
    for received in heard:
        assert received is not None, "nothing was said"
        if isinstance(received.message, Playback) and received.message.played > beyond:
            return


def test_space_pauses_n_and_the_arrow_step_a_frame_and_q_ends(straight: Path, tmp_path: Path) -> None:
    config = parsed({"bus": {"endpoint": f"unixsock-stream/{tmp_path}/bus.sock"}}, "test")
    frames = [m.stamp_ns for _, m in Recording(straight).messages((Frame,))]
    following = dict(pairwise(frames))
    with Router(config), Bus(config, "monitor", "test") as bus:
        heard = bus.listen(PLAYBACK, period_s=DEADLINE_S)
        with at_terminal("play", str(straight), "--connect", config.bus.endpoint) as terminal:
            before = terminal.settings()
            running(heard, 20)
            terminal.type(b" ")
            stands = standing(heard)
            for key in (b"n", b"\x1b[C", b"\x1bOC"):
                terminal.type(key)
                running(heard, stands.played)
                stepped = standing(heard)
                assert stepped.frame_ns == following[stands.frame_ns]
                assert stepped.frame_ns < stepped.ticks_ns <= following[stepped.frame_ns]
                stands = stepped
            terminal.type(b"nn")
            running(heard, stands.played)
            stepped = standing(heard)
            assert stepped.frame_ns == following[following[stands.frame_ns]]
            terminal.type(b"x ")
            running(heard, stepped.played + 50)
            terminal.type(b"q")
            code, shown = terminal.ended()
            assert terminal.settings() == before
    assert code == 0, shown
    assert "space pauses, n or the right arrow steps, q ends it" in shown
    assert "paused" in shown
    assert "played" in shown.splitlines()[-1]


def test_a_pipe_has_no_keys(capsys: pytest.CaptureFixture[str]) -> None:
    with keys({b"q": lambda: None}) as has_keys:
        assert not has_keys


def test_what_plays_in_the_background_leaves_the_terminal_alone(tmp_path: Path) -> None:
    """To change its settings from there would stop the process."""
    command = f"{sys.executable} -c 'from omnivert.cli.keys import keys\nwith keys({{}}) as has: print(has)' & wait $!"
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        ["bash", "-i", "-c", f"set -m; {command}"],
        stdin=theirs,
        stderr=theirs,
        stdout=subprocess.PIPE,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
    ) as process:
        out, _ = process.communicate(timeout=DEADLINE_S)
    os.close(theirs)
    os.close(ours)
    assert out.strip().endswith(b"False")


KEYS = """import sys, threading
from omnivert.cli.keys import keys
done, heard = threading.Event(), []
with keys({b" ": lambda: print("heard", flush=True), b"q": done.set}):
    print("listens", flush=True)
    try:
        done.wait()
    except KeyboardInterrupt:
        pass
print("en" + "ded", flush=True)
"""


@pytest.fixture
def shell(tmp_path: Path) -> Iterator[Terminal]:
    """An interactive shell, in which `python k.py` listens to keys."""
    (tmp_path / "k.py").write_text(KEYS)
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        ["bash", "--norc", "-i"],
        cwd=tmp_path,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2]), "PS1": "> ", "TERM": "dumb"},
    )
    try:
        terminal = Terminal(process, ours)
        terminal.type(f"{sys.executable} k.py\n".encode())
        terminal.await_shown("listens")
        yield terminal
    finally:
        process.kill()
        process.wait()
        os.close(theirs)
        os.close(ours)


def test_after_ctrl_z_and_fg_keys_are_heard_as_before(shell: Terminal) -> None:
    shell.type(b"\x1a")
    shell.await_shown("Stopped")
    shell.type(b"fg\n")
    shell.await_shown("heard", again=b" ")
    shell.type(b"q")
    shell.await_shown("ended")


def test_in_the_background_it_ends_without_the_terminal(shell: Terminal) -> None:
    shell.type(b"\x1a")
    shell.await_shown("Stopped")
    shell.type(b"bg\n")
    shell.type(b"kill -INT %1; wait\n")
    shell.await_shown("ended")


def test_up_shows_how_far_a_playback_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    screen = io.StringIO()
    monkeypatch.setattr(say, "err", lambda: Console(file=screen, force_terminal=True, width=100))
    config = parsed({"bus": {"endpoint": f"unixsock-stream/{tmp_path}/bus.sock"}}, "test")
    deadline = time.monotonic() + DEADLINE_S
    with Router(config), Bus(config, "player", "front") as player, followed_from_outside(config):
        assert player.await_presence(lambda: "progress" in {service for service, _ in player.present()}, DEADLINE_S)
        while " 37%" not in screen.getvalue():
            assert time.monotonic() < deadline
            player.publish(PLAYBACK, Playback(1, 37, 100, finished=False))
            player.wait_stopped(0.02)
        assert "playing" in screen.getvalue()
    assert not [thread for thread in threading.enumerate() if thread.name == "guest"]
