"""What a calibration will not believe of somebody's wheels."""

from collections.abc import Iterable

from omnivert.config import Config
from omnivert.formats.table import NS_PER_S
from omnivert.messages import Ticks
from omnivert.odometry import Odometer


def passed_over(source: str, ticks: Iterable[Ticks], config: Config) -> tuple[str, ...]:
    """What the odometer will refuse, in words: its limits are no part of a recording.

    They stay those of the configuration that a recording is calibrated with; so they are told now, while whoever wrote
    the source is here to read it.

    source  what the ticks are, "wheels.csv" or a topic
    """
    odometer = Odometer(config.encoder, config.robot.wheel_base_m)
    longest_ns, before_ns = 0, None
    for count in ticks:
        longest_ns = max(longest_ns, count.stamp_ns - (before_ns if before_ns is not None else count.stamp_ns))
        before_ns = count.stamp_ns
        odometer.push(count)
        odometer.forget_before(count.stamp_ns)
    limits = (
        f"encoder.max_gap_s = {config.encoder.max_gap_s:g} and encoder.max_speed_m_s = {config.encoder.max_speed_m_s:g}"
    )
    return tuple(
        f"{source}: {reason.removeprefix('ticks: ')}, {times} times; its counts are up to "
        f"{longest_ns / NS_PER_S:.3g} s apart, and a calibration holds them to {limits} of its configuration"
        for reason, times in odometer.refused.items()
    )
