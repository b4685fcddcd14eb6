"""The drive in other light, through other sensors and codecs."""

from dataclasses import replace

import cv2
import numpy as np

from omnivert.angles import TURN
from omnivert.messages import Frame, PixelFormat
from tests.vision.drive import Drive, Float, Grey
from tests.vision.painting import toned


def gains(drive: Drive, gain: Float) -> Drive:
    """Each frame brighter or darker, up to saturation."""
    return toned(drive, [np.clip(np.rint(np.arange(256) * g), 0, 255).astype(np.uint8) for g in gain])


def gain(drive: Drive, factor: float) -> Drive:
    return gains(drive, np.full(len(drive.frames), factor))


def swelling_gain(drive: Drive) -> Drive:
    """0.6 to 1.4 and back within 40 frames."""
    return gains(drive, 1.0 + 0.4 * np.sin(TURN / 40.0 * np.arange(len(drive.frames))))


def flickering_gain(drive: Drive) -> Drive:
    """1 and 0.6 by turns: an exposure control that hunts."""
    return gains(drive, np.where(np.arange(len(drive.frames)) % 2, 0.6, 1.0))


def gamma(drive: Drive, power: float) -> Drive:
    tone = np.rint(255.0 * (np.arange(256) / 255.0) ** power).astype(np.uint8)
    return toned(drive, [tone] * len(drive.frames))


def noise(drive: Drive, sigma: float) -> Drive:
    rng = np.random.default_rng(1)
    return drive.of(
        [np.clip(np.rint(p + rng.normal(0.0, sigma, p.shape)), 0, 255).astype(np.uint8) for p in drive.pictures()]
    )


def blur(drive: Drive, sigma: float) -> Drive:
    return drive.of([np.asarray(cv2.GaussianBlur(p, (0, 0), sigma), dtype=np.uint8) for p in drive.pictures()])


def encoded(drive: Drive, form: PixelFormat, quality: int = 95) -> Drive:
    """As compressed files, or in colour: a warm tint whose grey is the picture's own within a step."""

    def frame(picture: Grey, old: Frame) -> Frame:
        match form:
            case PixelFormat.JPEG:
                data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
            case PixelFormat.PNG:
                data = cv2.imencode(".png", picture)[1]
            case PixelFormat.BGR8:
                tint = np.array([0.80, 1.0, 1.0763])  # 0.114 b + 0.587 g + 0.299 r = 1
                data = np.clip(np.rint(picture[..., None] * tint), 0, 255)
            case PixelFormat.GREY8:
                data = picture
        return replace(old, format=form, data=np.asarray(data, dtype=np.uint8).ravel())

    return replace(drive, frames=tuple(frame(p, old) for p, old in zip(drive.pictures(), drive.frames, strict=True)))
