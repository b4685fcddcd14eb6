"""The configuration: one TOML file -> frozen, validated settings.

A table that is left out takes its defaults; an unknown key, a wrong type or a number out of range is refused.
"""

from omnivert.config.calibration import Calibration
from omnivert.config.camera import Camera, MirrorRing
from omnivert.config.encoder import Encoder
from omnivert.config.keeping import Player, Recorder, Storage
from omnivert.config.loading import load, parsed, with_rig
from omnivert.config.section import Section
from omnivert.config.settings import Config, Robot
from omnivert.config.transport import Bus, Timeline
from omnivert.config.vision import Dissimilarity, Vision

__all__ = [
    "Bus",
    "Calibration",
    "Camera",
    "Config",
    "Dissimilarity",
    "Encoder",
    "MirrorRing",
    "Player",
    "Recorder",
    "Robot",
    "Section",
    "Storage",
    "Timeline",
    "Vision",
    "load",
    "parsed",
    "with_rig",
]
