"""Frames as broken cameras, cables and people make them, each from a good one."""

from dataclasses import replace

import cv2
import numpy as np

from omnivert.angles import TURN
from omnivert.bench.vision import raw
from omnivert.config import Config
from omnivert.messages import Frame, PixelFormat
from omnivert.vision.image import grey_from_frame
from tests.vision.drive import Grey, Point
from tests.vision.painting import polar


def texture(shape: tuple[int, ...], grain_px: float, seed: int = 3) -> Grey:
    """Blurred noise of full contrast: no rim, no lines."""
    rough = cv2.GaussianBlur(np.random.default_rng(seed).normal(0.0, 1.0, shape), (0, 0), grain_px)
    rough = (rough - rough.min()) / (rough.max() - rough.min())
    return np.asarray(np.rint(255.0 * rough), dtype=np.uint8)


def blinds(config: Config, count: int) -> Grey:
    """`count` thin dark bars along the radius, evenly around: twice as many edges."""
    radius, angle = polar((config.camera.height_px, config.camera.width_px), config.ring.center_px)
    wave = np.cos(angle * count)
    inside = np.clip(config.ring.r_max_px - radius + 0.5, 0.0, 1.0) * (radius > config.ring.r_min_px)
    return np.asarray(np.rint((120.0 + 100.0 * np.clip(2.0 * wave, -1.0, 1.0)) * inside), dtype=np.uint8)


def smeared(picture: Grey, length_px: int) -> Grey:
    """Motion blur, straight and level."""
    return np.asarray(cv2.blur(picture, (length_px, 1)), dtype=np.uint8)


def turned(picture: Grey, center: Point, angle_rad: float, steps: int = 25) -> Grey:
    """Motion blur of a camera that turns by the angle while the shutter is open; the rim stays sharp."""
    size = (picture.shape[1], picture.shape[0])
    total = np.zeros(picture.shape)
    for part in np.linspace(-0.5, 0.5, steps):
        M = cv2.getRotationMatrix2D(center, float(np.rad2deg(angle_rad * part)), 1.0)
        total += cv2.warpAffine(picture, M, size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(np.rint(total / steps), dtype=np.uint8)


def hand_over_all(picture: Grey, center: Point, radius_px: float) -> Grey:
    """A hand close before the mirror: all of the world and most of the rim."""
    radius, angle = polar(picture.shape, center)
    fingers = radius < radius_px * (1.08 + 0.10 * np.cos(5.0 * angle))
    alpha = cv2.GaussianBlur(fingers.astype(np.float32), (0, 0), 2.0)
    skin = 90.0 + 0.15 * texture(picture.shape, 8.0)
    return np.asarray(np.rint(picture * (1.0 - alpha) + skin * alpha), dtype=np.uint8)


def bad_frames(good: Frame, config: Config) -> dict[str, Frame]:
    """By name; `good` is raw or JPEG."""
    picture = grey_from_frame(good)
    height, width = picture.shape
    center, r_max = config.ring.center_px, config.ring.r_max_px
    jpeg = np.asarray(cv2.imencode(".jpg", picture)[1], dtype=np.uint8).ravel()
    half = picture.copy()
    half[height // 2 :] = 0
    most = picture.copy()
    most[2 * height // 3 :] = 0
    pictures = {
        "black": np.zeros_like(picture),
        "white": np.full_like(picture, 255),
        "grey": np.full_like(picture, 128),
        "saturated": np.clip(picture.astype(np.int64) * 12, 0, 255).astype(np.uint8),
        "underexposed": (picture // 40).astype(np.uint8),
        "noise": np.random.default_rng(1).integers(0, 256, picture.shape, dtype=np.uint8),
        "texture": texture(picture.shape, 3.0),
        "half black": half,
        "a third black": most,
        "smeared": smeared(picture, 31),
        "turning blur": turned(picture, center, TURN / 40.0),
        "hand over all": hand_over_all(picture, center, r_max),
        "empty mirror": np.where(polar(picture.shape, center)[0] < r_max, 120, 15).astype(np.uint8),
        "blinds": blinds(config, 1500),
        "coarse blinds": blinds(config, 300),
    }
    frames = {name: raw(p, good.stamp_ns) for name, p in pictures.items()}
    frames["half a jpeg"] = Frame(good.stamp_ns, PixelFormat.JPEG, width, height, jpeg[: jpeg.size // 2])
    ended = np.concatenate((jpeg[: jpeg.size // 2], np.array([0xFF, 0xD9], dtype=np.uint8)))
    frames["half a jpeg, ended"] = Frame(good.stamp_ns, PixelFormat.JPEG, width, height, ended)
    flipped = jpeg.copy()
    flipped[jpeg.size // 2 : jpeg.size // 2 + 40] ^= 0x5A
    frames["jpeg with wrong bytes"] = Frame(good.stamp_ns, PixelFormat.JPEG, width, height, flipped)
    small = cv2.resize(picture, (width // 2, height // 2), interpolation=cv2.INTER_AREA).astype(np.uint8)
    frames["another size"] = raw(small, good.stamp_ns)
    frames["short"] = replace(good, format=PixelFormat.GREY8, data=picture.ravel()[:-1].copy())
    return frames
