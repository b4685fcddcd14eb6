"""What covers a picture or is painted into it, and what is then left of the true edges."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from omnivert.angles import TURN, wrap
from omnivert.bench.score.truth import FrameTruth
from omnivert.config import Config
from tests.vision.drive import Drive, Float, Grey, Point, image_angle

Mask = NDArray[np.bool_]

_BESIDE_PX = 2.5  # how far from an edge its two sides are looked at
_SEEN_STEP = 3.0  # grey steps


def polar(shape: tuple[int, ...], center: Point) -> tuple[Float, Float]:
    """Radius and image angle of each pixel, (H, W)."""
    v, u = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    return np.hypot(u - center[0], v - center[1]), np.arctan2(center[1] - v, u - center[0])


def center_of(truth: FrameTruth) -> Point:
    assert truth.center_px is not None
    return truth.center_px


def steps(picture: Grey, truth: FrameTruth, config: Config) -> tuple[Float, Float, Float]:
    """Signed grey step across each true edge along its radius, (E, R), and where, u and v, (E, R)."""
    cu, cv = center_of(truth)
    radius = np.linspace(config.ring.r_min_px + 2.0, config.ring.r_max_px - 3.0, 80)
    angle = image_angle(truth.bearing_rad, config)[:, None]
    side = _BESIDE_PX / radius * (config.ring.r_max_px / 225.0)

    def at(turn: Float) -> tuple[Float, Float]:
        return cu + radius * np.cos(turn), cv - radius * np.sin(turn)

    def grey(turn: Float) -> Float:
        u, v = (a.astype(np.float32) for a in at(turn))
        return np.asarray(cv2.remap(picture, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), dtype=np.float64)

    return grey(angle + side) - grey(angle - side), *at(angle)


def toned(drive: Drive, tones: list[Grey]) -> Drive:
    """Each picture through its table of 256 tones; the contrast of the true edges follows."""
    pictures, truths = [], []
    for picture, truth, tone in zip(drive.pictures(), drive.truth, tones, strict=True):
        after = tone[picture]
        old, new = (np.abs(steps(p, truth, drive.config)[0]) for p in (picture, after))
        seen = old > _SEEN_STEP
        whole, left = np.sum(old * seen, axis=1), np.sum(new * seen, axis=1)
        common = float(np.sum(new) / np.sum(old))
        change = np.where(whole > 10.0 * _SEEN_STEP, left / np.maximum(whole, 1e-9), common)
        pictures.append(after)
        truths.append(replace(truth, contrast=truth.contrast * change))
    return drive.of(pictures, truths)


def hidden(picture: Grey, truth: FrameTruth, config: Config, mask: Mask) -> FrameTruth:
    """The truth when the masked pixels, and all beyond the picture that the mask is of, are not seen.

    Of each edge the share of its grey step goes that lies there.
    """
    step, u, v = steps(picture, truth, config)
    weight = np.abs(step) * (np.abs(step) > _SEEN_STEP)
    weight[np.sum(weight, axis=1) < 10.0 * _SEEN_STEP] = 1.0
    column, row = np.rint(u).astype(int), np.rint(v).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
    covered = np.where(inside, mask[row.clip(0, mask.shape[0] - 1), column.clip(0, mask.shape[1] - 1)], True)
    left = 1.0 - np.sum(weight * covered, axis=1) / np.sum(weight, axis=1)
    return replace(truth, visible_fraction=truth.visible_fraction * left)


def radial_border(mask: Mask, center: Point, config: Config) -> Float:
    """Bearings at which the mask's border runs along a radius within 35 deg: what is seen there is of the cover."""
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2.0)
    gu, gv = cv2.Sobel(soft, cv2.CV_32F, 1, 0), cv2.Sobel(soft, cv2.CV_32F, 0, 1)
    row, column = np.nonzero(np.hypot(gu, gv) > 0.1)
    gu, gv, x, y = gu[row, column], gv[row, column], column - center[0], center[1] - row
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    border = np.abs(np.cos(angle) * gu - np.sin(angle) * gv) < np.sin(np.deg2rad(35.0)) * np.hypot(gu, gv)
    border &= (radius > config.ring.r_min_px) & (radius < config.ring.r_max_px)
    cell = np.unique(np.floor(angle[border] / TURN * 720.0))
    return image_angle(wrap((cell + 0.5) / 720.0 * TURN), config)


def covered(picture: Grey, truth: FrameTruth, config: Config, mask: Mask, cover: Grey) -> tuple[Grey, FrameTruth]:
    """The picture with a cover in front of it where the mask is; its border, soft as all in the picture, is neither."""
    alpha = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 1.2)
    after = np.rint(picture * (1.0 - alpha) + cover * alpha).astype(np.uint8)
    border = radial_border(mask, center_of(truth), config)
    left = hidden(picture, truth, config, mask)
    return after, replace(left, neither_rad=np.concatenate((truth.neither_rad, border)))


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar along a radius: two edges."""

    angle_rad: float  # image angle of its middle
    half_rad: float
    inner_px: float
    outer_px: float
    level: float  # grey


def painted(picture: Grey, truth: FrameTruth, config: Config, bars: list[Bar]) -> tuple[Grey, FrameTruth, FrameTruth]:
    """The picture with the bars, later ones in front; the truth of the rest; the truth of their edges, ids from 0 on.

    Edge 2 i of bar i is the one at the smaller image angle.
    """
    center = center_of(truth)
    radius, angle = (a.ravel() for a in polar(picture.shape, center))
    after = picture.astype(np.float64).ravel()
    owner = np.full(picture.size, -1)
    for i, bar in enumerate(bars):
        near = np.flatnonzero(np.cos(angle - bar.angle_rad) > np.cos(bar.half_rad + 0.05))
        across = 0.5 + (bar.half_rad - np.abs(wrap(angle[near] - bar.angle_rad))) * radius[near] / 1.5
        along = 0.5 + np.minimum(radius[near] - bar.inner_px, bar.outer_px - radius[near]) / 1.5
        alpha = np.clip(across, 0.0, 1.0) * np.clip(along, 0.0, 1.0)
        after[near] += alpha * (bar.level - after[near])
        owner[near[alpha > 0.5]] = i
    front = owner.reshape(picture.shape)
    rest = hidden(picture, truth, config, front >= 0)
    result = np.rint(after).astype(np.uint8).reshape(picture.shape)
    edges = np.array([bar.angle_rad + side * bar.half_rad for bar in bars for side in (-1.0, 1.0)])
    extent = np.array([(bar.outer_px - bar.inner_px) for bar in bars for _ in "lr"])
    ids = np.arange(edges.size)
    none = np.empty(0)
    bare = FrameTruth(ids, image_angle(wrap(edges), config), np.ones(edges.size), np.ones(edges.size), none, center)
    step, u, v = steps(result, bare, config)
    here = np.hypot(u - center[0], v - center[1])
    fraction, contrast = np.zeros(edges.size), np.zeros(edges.size)
    for e in range(edges.size):
        bar = bars[e // 2]
        side = (e % 2) * 2 - 1  # a pixel inside the bar
        turn = edges[e] - side * 1.0 / here[e]
        row = np.rint(center[1] - here[e] * np.sin(turn)).astype(int).clip(0, picture.shape[0] - 1)
        column = np.rint(center[0] + here[e] * np.cos(turn)).astype(int).clip(0, picture.shape[1] - 1)
        own = (here[e] > bar.inner_px) & (here[e] < bar.outer_px) & (front[row, column] == e // 2)
        whole = np.count_nonzero((here[e] > bar.inner_px) & (here[e] < bar.outer_px))
        fraction[e] = extent[e] / (config.ring.r_max_px - config.ring.r_min_px) * np.count_nonzero(own) / max(whole, 1)
        contrast[e] = float(np.mean(np.abs(step[e][own]))) if np.any(own) else 0.0
    return result, rest, replace(bare, visible_fraction=fraction, contrast=contrast)
