"""What encoders speak: one module for each protocol, and the table of them."""

from math import pi

from omnivert.config import Encoder
from omnivert.drivers.protocols.create2 import COUNTER_BITS as CREATE2_BITS
from omnivert.drivers.protocols.create2 import Create2
from omnivert.drivers.protocols.omnivert_line import OmnivertLine
from omnivert.drivers.protocols.roboclaw import COUNTER_BITS as ROBOCLAW_BITS
from omnivert.drivers.protocols.roboclaw import RoboClaw
from omnivert.drivers.protocols.ros_arduino import ASK, TIMES, RosArduino
from omnivert.drivers.protocols.ros_arduino import COUNTER_BITS as ROS_ARDUINO_BITS

__all__ = [
    "PROTOCOLS",
    "AnyParser",
    "Create2",
    "OmnivertLine",
    "RoboClaw",
    "RosArduino",
    "counter_bits",
    "counts_per_s",
    "parser",
]

PROTOCOLS = {  # encoder.protocol -> what it is, in one line
    "omnivert": "lines of text with device time and CRC-16, sent by themselves (deploy/encoder-protocol.md); any baud",
    "ros_arduino_bridge": "asked by e three times over, no checksum, no device time; usually 57600 baud",
    "roboclaw": "packet serial, asked by command 78, CRC-16, no device time; 38400 baud, over USB any",
    "create2": "iRobot Create 2 and Roomba 600, streamed every 15 ms, 8-bit checksum, no device time; 115200 baud",
}
TRIPLE_S = 0.002  # in which ros_arduino_bridge reads its counters three times over, besides the way of the questions


AnyParser = OmnivertLine | RosArduino | RoboClaw | Create2


def parser(config: Encoder) -> AnyParser:
    """For the protocol that is configured, with nothing heard yet."""
    match config.protocol:
        case "omnivert":
            return OmnivertLine()
        case "ros_arduino_bridge":
            triple_s = TRIPLE_S + 10.0 * len(ASK) * (TIMES - 1) / config.baud
            return RosArduino(counts_per_s(config) * triple_s + 2.0)
        case "roboclaw":
            return RoboClaw(config.address)
        case "create2":
            return Create2()


def counter_bits(config: Encoder) -> int:
    """Width of the device's counters: the protocol's, or where that leaves it open, as configured."""
    match config.protocol:
        case "ros_arduino_bridge":
            return ROS_ARDUINO_BITS
        case "roboclaw":
            return ROBOCLAW_BITS
        case "create2":
            return CREATE2_BITS
        case "omnivert":
            return config.counter_bits


def counts_per_s(config: Encoder) -> float:
    """The most that a wheel can make."""
    return config.max_speed_m_s * config.ticks_per_rev / (config.wheel_diameter_m * pi)
