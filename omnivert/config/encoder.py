"""The wheel encoders: where they are, what they count, how far their clock is believed."""

from typing import Annotated, Literal

from pydantic import Field, PlainSerializer

from omnivert.config.section import Id, Section, Sign

Counts = Annotated[float, PlainSerializer(lambda counts: int(counts) if counts == int(counts) else counts)]


class Encoder(Section):
    """The wheel encoders."""

    id: Id = "base"
    """Names the encoders in keys."""
    protocol: Literal["omnivert", "ros_arduino_bridge", "roboclaw", "create2"] = "omnivert"
    """What the device speaks: deploy/encoder-protocol.md tells of each."""
    port: str = "/dev/ttyUSB0"
    """Any pyserial port or URL; a name in /dev/serial/by-id stays the same when the plug goes into another socket."""
    baud: int = Field(115200, ge=300, le=4_000_000)
    """Bits per second on the line; as the device is set."""
    poll_rate_hz: float = Field(50.0, ge=1.0, le=1000.0)
    """How often a device that must be asked is asked, times a second: ros_arduino_bridge and roboclaw."""
    address: int = Field(128, ge=128, le=135)
    """Of a roboclaw on its line."""
    wheel_diameter_m: float = Field(0.15, ge=0.01, le=2.0)
    """Diameter of the driven wheels, under load: rho is as right as this."""
    ticks_per_rev: Counts = Field(2000, ge=1, le=10_000_000)
    """Counts per turn of the wheel, gear included; need not be whole."""
    swap_sides: bool = False
    """true where the device calls the robot's right wheel left; a roboclaw's left is M1."""
    left_sign: Sign = 1
    """-1 where this side's raw count falls when the robot drives forward; after swap_sides."""
    right_sign: Sign = 1
    """The same of the right wheel."""
    counter_bits: int = Field(32, ge=8, le=63)
    """Width of the device's counters, for undoing their rollover; other protocols than omnivert know theirs."""
    max_speed_m_s: float = Field(5.0, gt=0.0, le=100.0)
    """A wheel that seems faster than this between two messages has jumped, not driven."""
    max_gap_s: float = Field(0.5, gt=0.0, le=60.0)
    """After a longer silence in which the wheels turned, the way between is unknown."""
    noise_k_m: float = Field(2e-4, gt=0.0, le=0.1)
    """K of eq. 31: variance of a wheel's displacement per metre driven (Chong and Kleeman)."""
    clock_window_s: float = Field(30.0, ge=1.0, le=3600.0)
    """The device's clock is fitted to this machine's over this time; longer averages more, shorter follows drift."""
    clock_max_skew: float = Field(0.01, ge=0.0, le=0.1)
    """Largest relative error of the device's clock; ceramic resonators reach 0.005."""
    restart_after_lines: int = Field(5, ge=2, le=1000)
    """Refused readings in a row that agree among each other, until the device is taken to have been restarted."""
    reopen_s: float = Field(0.5, ge=0.01, le=60.0)
    """Pause between two attempts to open the port."""
    silent_after_s: float = Field(2.0, gt=0.0, le=3600.0)
    """Without a right reading for so long, health says that the encoder is silent."""

    @property
    def metres_per_tick(self) -> float:
        return self.wheel_diameter_m * 3.141592653589793 / self.ticks_per_rev
