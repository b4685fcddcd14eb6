"""The drive through other cameras and mirrors: other sizes, mirror images, tilted axes, a picture cut off."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from omnivert.bench.growth import scaled_config
from omnivert.bench.score.truth import FrameTruth
from omnivert.config import Config
from tests.vision.drive import Drive, Float, Grey, Point, image_angle
from tests.vision.painting import center_of, hidden


def mapped(truth: FrameTruth, H: Float, before: Config, after: Config) -> tuple[FrameTruth, Point]:
    """The truth of the picture that the homography makes, and where its lines meet.

    Lines stay straight; a ray from the centre c leaves H c along the derivative of H there. The rim, a conic C, becomes
    H^-T C H^-1, an ellipse whose own centre is not H c when H is no affine map.
    """
    cu, cv = center_of(truth)
    w = H @ np.array([cu, cv, 1.0])
    meeting = w[:2] / w[2]
    slope = (H[:2, :2] - np.outer(meeting, H[2, :2])) / w[2]
    angle = image_angle(np.concatenate((truth.bearing_rad, truth.neither_rad)), before)
    du, dv = slope @ np.stack((np.cos(angle), -np.sin(angle)))
    bearing = image_angle(np.arctan2(-dv, du), after)
    r = before.ring.r_max_px
    rim = np.array([[1.0, 0.0, -cu], [0.0, 1.0, -cv], [-cu, -cv, cu**2 + cv**2 - r**2]])
    back = np.linalg.inv(H)
    conic = back.T @ rim @ back
    center = np.linalg.solve(conic[:2, :2], -conic[:2, 2])
    n = truth.line_id.size
    moved = replace(
        truth, bearing_rad=bearing[:n], neither_rad=bearing[n:], center_px=(float(center[0]), float(center[1]))
    )
    return moved, (float(meeting[0]), float(meeting[1]))


def reframed(drive: Drive, H: Float, config: Config, picture: Callable[[Grey], Grey] | None = None) -> Drive:
    """The drive through a homography of its pictures (pixel centres at whole coordinates)."""
    size = (config.camera.width_px, config.camera.height_px)

    def warp(p: Grey) -> Grey:
        return np.asarray(cv2.warpPerspective(p, H, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))

    moved = [mapped(t, H, drive.config, config) for t in drive.truth]
    whole = drive.of([np.ascontiguousarray((picture or warp)(p)) for p in drive.pictures()], [t for t, _ in moved])
    return replace(whole, config=config, meeting_px=tuple(m for _, m in moved))


def _with(config: Config, size: tuple[int, int], center: Point, sign: int = 1) -> Config:
    camera = config.camera.model_copy(update={"width_px": size[0], "height_px": size[1], "bearing_sign": sign})
    return config.model_copy(update={"camera": camera, "ring": config.ring.model_copy(update={"center_px": center})})


def mirrored(drive: Drive) -> Drive:
    """Left and right changed: the angle falls with the bearing, which counts from the other side."""
    width, height = drive.config.camera.width_px, drive.config.camera.height_px
    u, v = drive.config.ring.center_px
    H = np.array([[-1.0, 0.0, width - 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    return reframed(drive, H, _with(drive.config, (width, height), (width - 1.0 - u, v), -1), lambda p: p[:, ::-1])


def quarter_turned(drive: Drive) -> Drive:
    """A portrait picture: turned by 90 deg, counter-clockwise."""
    width, height = drive.config.camera.width_px, drive.config.camera.height_px
    u, v = drive.config.ring.center_px
    H = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, width - 1.0], [0.0, 0.0, 1.0]])
    config = _with(drive.config, (height, width), (v, width - 1.0 - u))
    return reframed(drive, H, config, lambda p: np.asarray(np.rot90(p)))


def resized(drive: Drive, height: int) -> Drive:
    scale = height / drive.config.camera.height_px
    config = scaled_config(drive.config, scale)
    size = (config.camera.width_px, config.camera.height_px)
    half = 0.5 * scale - 0.5
    H = np.array([[scale, 0.0, half], [0.0, scale, half], [0.0, 0.0, 1.0]])
    way = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_CUBIC
    return reframed(drive, H, config, lambda p: np.asarray(cv2.resize(p, size, interpolation=way)))


def off_center(drive: Drive) -> Drive:
    """In a picture of 800 x 600 the ring lies at its lower right."""
    u, v = drive.config.ring.center_px
    H = np.array([[1.0, 0.0, 145.0], [0.0, 1.0, 112.0], [0.0, 0.0, 1.0]])
    return reframed(drive, H, _with(drive.config, (800, 600), (u + 145.0, v + 112.0)))


_MIRROR_PX, _MIRROR_XI = 143.57976517604894, 0.9662164547513388  # of the corridor's: r = K cos e / (xi - sin e)


def tilted(drive: Drive, tilt_deg: float, way_deg: float = 30.0) -> Drive:
    """The axis of camera and mirror leans by a little, as when the robot's mast is bent; the rim stays where it was.

    The camera has one viewpoint, so each ray of the leaning camera is one of the upright one, turned. Edges keep their
    bearings. What the upright camera did not see beside its rim is filled with what it saw last.
    """
    return drive.of([_leaning(p, t, drive.config, tilt_deg, way_deg) for p, t in _with_truth(drive)], drive.truth)


def _with_truth(drive: Drive) -> list[tuple[Grey, FrameTruth]]:
    return list(zip(drive.pictures(), drive.truth, strict=True))


def _leaning(picture: Grey, truth: FrameTruth, config: Config, tilt_deg: float, way_deg: float) -> Grey:
    cu, cv = center_of(truth)
    ring, (height, width) = config.ring, picture.shape
    v, u = np.mgrid[:height, :width]
    x, y = u - cu, -(v - cv)
    r, a = np.hypot(x, y), np.arctan2(y, x)
    e = np.arcsin(_MIRROR_XI * r / np.hypot(r, _MIRROR_PX)) - np.arctan2(_MIRROR_PX, r)
    ray = np.stack((np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)))
    tilt, way = np.deg2rad(tilt_deg), np.deg2rad(way_deg)
    axis = np.array([-np.sin(way), np.cos(way), 0.0])
    cross = np.array([[0.0, 0.0, axis[1]], [0.0, 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    turn = np.eye(3) + np.sin(tilt) * cross + (1.0 - np.cos(tilt)) * cross @ cross
    there = np.einsum("ij,jvu->ivu", turn, ray)
    sine = np.clip(there[2], -1.0, 1.0)
    from_r = _MIRROR_PX * np.sqrt(1.0 - sine**2) / np.maximum(_MIRROR_XI - sine, 1e-3)
    from_r = np.clip(from_r, ring.r_min_px + 3.0, ring.r_max_px - 3.0)
    from_a = np.arctan2(there[1], there[0])
    seen = (r < ring.r_max_px - 2.0) & (r > ring.r_min_px)
    map_u = np.where(seen, cu + from_r * np.cos(from_a), u).astype(np.float32)
    map_v = np.where(seen, cv - from_r * np.sin(from_a), v).astype(np.float32)
    return np.asarray(cv2.remap(picture, map_u, map_v, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def stretched(drive: Drive, stretch: float, way_deg: float = 80.0) -> Drive:
    """A camera that does not look along the mirror's axis: the rim is an ellipse, longer by `stretch` one way."""
    u, v = drive.config.ring.center_px
    way = np.deg2rad(way_deg)
    axis = np.array([np.cos(way), np.sin(way)])
    H = np.eye(3)
    H[:2, :2] += stretch * (np.outer(axis, axis) - 0.5 * np.eye(2))
    there = np.array([[1.0, 0.0, u], [0.0, 1.0, v], [0.0, 0.0, 1.0]])
    return reframed(drive, there @ H @ np.linalg.inv(there), drive.config)


def cut_off(drive: Drive) -> Drive:
    """The picture ends below so that a fifth of the rim lies outside."""
    u, v = drive.config.ring.center_px
    rows = round(v + drive.config.ring.r_max_px * np.cos(0.2 * np.pi))
    width = drive.config.camera.width_px
    seen = np.zeros((rows, width), dtype=np.bool_)
    truth = [hidden(p, t, drive.config, seen) for p, t in zip(drive.pictures(), drive.truth, strict=True)]
    short = drive.of([np.ascontiguousarray(p[:rows]) for p in drive.pictures()], truth)
    return replace(short, config=_with(drive.config, (width, rows), (u, v)))
