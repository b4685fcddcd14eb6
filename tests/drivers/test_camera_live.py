"""What a live camera tells of itself, whose stamp its frames carry, and real streams of the network."""

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from omnivert.config import Camera
from omnivert.drivers.camera import CameraEvent, Described, camera_events
from omnivert.drivers.camera_facts import CameraFacts, Stamp
from omnivert.drivers.camera_look import look
from omnivert.drivers.device import Lost, Opened, Refused
from omnivert.drivers.stream_clock import StreamClock
from omnivert.messages import Frame

PICTURE = np.random.default_rng(5).integers(0, 256, (48, 64, 3), np.uint8)
V4L2 = {
    cv2.CAP_PROP_BACKEND: float(cv2.CAP_V4L2),
    cv2.CAP_PROP_FPS: 30.0,
    cv2.CAP_PROP_EXPOSURE: 156.0,
    cv2.CAP_PROP_AUTO_EXPOSURE: 1.0,
}


class Told:
    """A capture that answers what it is told to; each frame comes with its place and time."""

    def __init__(self, properties: dict[int, float], places_ms: list[float]) -> None:
        self._properties = dict(properties)
        self._places_ms = iter(places_ms)

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def grab(self) -> bool:
        place_ms = next(self._places_ms, None)
        self._properties[cv2.CAP_PROP_POS_MSEC] = place_ms or 0.0
        return place_ms is not None

    def retrieve(self) -> tuple[bool, Any]:
        return True, PICTURE

    def get(self, propId: int) -> float:
        return self._properties.get(propId, -1.0)

    def set(self, propId: int, value: float) -> bool:
        return True

    def release(self) -> None:
        pass


def described(properties: dict[int, float], place_ms: float = 0.0, **config: Any) -> CameraFacts:
    events = camera_events(
        Camera(source="0", **config), threading.Event(), capture=lambda _: Told(properties, [place_ms])
    )
    return next(event.facts for event in events if isinstance(event, Described))


def test_a_camera_tells_its_stamp_rate_and_exposure() -> None:
    facts = described(V4L2, 1e-6 * time.monotonic_ns())
    assert (facts.stamp, facts.rate_hz, facts.by_hand) == (Stamp.KERNEL, 30.0, True)
    assert facts.exposure_s == pytest.approx(0.0156)
    assert str(facts).endswith("; 30 Hz, asked for 15; exposure 15.6 ms fixed")
    automatic = described({**V4L2, cv2.CAP_PROP_AUTO_EXPOSURE: 3.0}, frame_rate_hz=30.0)
    assert str(automatic) == f"stamped by {Stamp.ARRIVAL}; 30 Hz; exposure 15.6 ms now, automatic"


def test_what_a_source_does_not_tell_is_not_made_up() -> None:
    facts = described({cv2.CAP_PROP_BACKEND: float(cv2.CAP_FFMPEG), cv2.CAP_PROP_EXPOSURE: 156.0})
    assert (facts.rate_hz, facts.exposure_s, facts.by_hand) == (None, None, None)
    assert str(facts) == f"stamped by {Stamp.ARRIVAL}"


def test_a_frame_that_is_stamped_before_the_last_one_is_refused() -> None:
    now_ms = 1e-6 * time.monotonic_ns()
    capture = Told(V4L2, [now_ms, now_ms - 40.0, now_ms])
    events = camera_events(Camera(source="0"), threading.Event(), capture=lambda _: capture)
    assert [type(event) for event in islice(events, 5)] == [Opened, Described, Frame, Refused, Refused]


# ---------------------------------------------------------------- the sender's clock


def stamps(source: str, sent_s: np.ndarray, delay_s: np.ndarray, place_s: np.ndarray) -> tuple[np.ndarray, list[Stamp]]:
    """(N,) s, how long after it was sent each frame is stamped; and whose stamps they are."""
    clock, late, whose = StreamClock(source), [], []
    for sent, delay, place in zip(sent_s, delay_s, place_s, strict=True):
        arrival_ns = round((1000.0 + sent + delay) * 1e9)
        late.append(1e-9 * clock.step(1e3 * place, arrival_ns) - 1000.0 - sent)
        whose.append(clock.stamp)
    return np.array(late), whose


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("skew", [0.0, 2e-4])
def test_the_senders_times_undo_the_jitter_of_the_network(seed: int, skew: float) -> None:
    rng = np.random.default_rng(seed)
    sent_s = np.arange(900) / 15.0
    delay_s = 0.050 + rng.exponential(0.030, sent_s.size)
    late, whose = stamps("rtsp://robot/mirror", sent_s, delay_s, (sent_s + 7.0) * (1.0 + skew))
    assert whose[0] is Stamp.ARRIVAL
    assert set(whose[150:]) == {Stamp.STREAM}
    assert np.std(late[450:]) < 0.1 * np.std(delay_s)
    assert np.all(late[450:] > 0.045)  # before it was sent nothing is stamped, but for the fastest way


def test_times_that_are_made_up_are_never_believed() -> None:
    sent_s = np.arange(300) / 15.0
    delay_s = np.full(sent_s.size, 0.05)
    for source, place_s in (
        ("rtsp://robot/mirror", np.arange(1, 301) / 25.0),  # counted at another rate
        ("http://robot/mirror", sent_s + 1.0),  # no times in it
        ("rtsp://robot/mirror", np.zeros(300)),  # none told
    ):
        late, whose = stamps(source, sent_s, delay_s, place_s)
        assert set(whose) == {Stamp.ARRIVAL}
        assert np.allclose(late, delay_s, atol=1e-6)


def test_a_sender_whose_clock_jumps_is_watched_anew() -> None:
    sent_s = np.arange(300) / 15.0
    for jump_s in (-50.0, 100.0, -1.5):
        place_s = np.where(sent_s < 10.0, sent_s + 60.0, sent_s + 60.0 + jump_s)
        late, whose = stamps("rtsp://robot/mirror", sent_s, np.full(sent_s.size, 0.05), place_s)
        assert np.all(np.abs(late - 0.05) < 1e-3)
        assert (whose[149], whose[155], whose[299]) == (Stamp.STREAM, Stamp.ARRIVAL, Stamp.STREAM)


# ---------------------------------------------------------------- real streams


class Sender:
    """A camera of the network: one JPEG after another over HTTP, for as long as it is there."""

    def __init__(self, port: int = 0) -> None:
        gone = self.gone = threading.Event()
        body = cv2.imencode(".jpg", np.repeat(np.repeat(PICTURE, 4, 0), 4, 1))[1].tobytes()

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(body)}\r\n\r\n".encode()
                try:
                    while not gone.wait(0.02):
                        self.wfile.write(head + body + b"\r\n")
                except OSError:
                    return

            def log_message(self, *_: object) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self.port = self._server.server_port
        threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True).start()

    def leave(self) -> None:
        self.gone.set()
        self._server.shutdown()
        self._server.server_close()


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def next_of(events: Iterator[CameraEvent], kind: type) -> Any:
    return next(event for event in events if isinstance(event, kind))


def test_a_stream_of_the_network_that_vanishes_and_comes_back_gives_frames_again() -> None:
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    sender = Sender(free_port())
    stop = threading.Event()
    events = camera_events(Camera(source=f"http://127.0.0.1:{sender.port}/mirror.mjpg", reopen_s=0.05), stop)
    before = next_of(events, Frame)
    assert (before.width_px, before.height_px) == (256, 192)
    sender.leave()
    assert next_of(events, Lost) == Lost("gives no more frames")
    assert next_of(events, Lost) == Lost("does not open")
    again = Sender(sender.port)
    assert isinstance(next(events), Opened)
    assert next_of(events, Described).facts.stamp is Stamp.ARRIVAL
    assert next_of(events, Frame).stamp_ns > before.stamp_ns
    stop.set()
    again.leave()
    assert not [event for event in events if isinstance(event, Frame)]


def test_a_look_tells_rate_gap_and_size_or_why_there_is_nothing(tmp_path: Any) -> None:
    now_ms = 1e-6 * time.monotonic_ns()
    places = [now_ms - 900.0 + at for at in (0.0, 50.0, 100.0, 300.0, 350.0)]
    seen = look(Camera(source="0"), 0.34, capture=lambda _: Told(V4L2, places))
    assert (seen.frames, seen.width_px, seen.height_px) == (5, 64, 48)
    assert seen.rate_hz == pytest.approx(4 / 0.35, rel=1e-3)
    assert seen.longest_gap_s == pytest.approx(0.2, rel=1e-3)
    assert "exposure 15.6 ms fixed" in seen.told
    nothing = look(Camera(source=str(tmp_path / "away"), reopen_s=0.01), patience_s=0.1)
    assert (nothing.frames, nothing.rate_hz, nothing.reason) == (0, None, "is not there")


def test_what_a_broken_source_makes_ffmpeg_say_reaches_nobody(tmp_path: Path) -> None:
    """In a process of its own: FFmpeg is told once how much to say."""
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(b"\x00\x00\x00\x20ftypisom\x00\x00\x02\x00isomiso2avc1mp41")
    see = (
        "import sys; from omnivert.config import Camera; from omnivert.drivers.camera_look import look;"
        "print(look(Camera(source=sys.argv[1])).reason)"
    )
    seen = subprocess.run([sys.executable, "-c", see, str(cut)], capture_output=True, text=True, timeout=60.0)
    assert (seen.stdout, seen.stderr) == ("is no video that OpenCV can read\n", "")
