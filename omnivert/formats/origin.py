"""Where a recording that was made from a bag has its zero, so that results can go back to the bag's own times."""

import json
from collections.abc import Mapping
from typing import Any

ATTACHMENT = "rosbag.json"  # in the recording
_KEY = "clock_origin_ns"


def written(origin_ns: int, **more: Any) -> bytes:
    """The attachment: the bag's time at the recording's zero, and what else is to be told."""
    return json.dumps({**more, _KEY: origin_ns}, indent=2).encode()


def origin_ns(attachment: bytes) -> int:
    """The bag's time at the recording's zero; 0 when it is somebody else's attachment."""
    try:
        told = json.loads(attachment)
    except ValueError:
        return 0
    origin = told.get(_KEY) if isinstance(told, Mapping) else None
    return origin if isinstance(origin, int) and abs(origin) < 2**62 else 0
