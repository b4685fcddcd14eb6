"""The mirror is a hyperboloid of glass: held against rays that are reflected at it, and against rotations by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from omnivert.simulation.mirror import Mirror, level_from_mirror, seen_by

eccentricities = st.floats(1.05, 5.0)
elevations = st.floats(-1.2, 0.4)
angles = st.floats(-np.pi, np.pi, exclude_max=True)


def reflected(eccentricity: float, elevation: float) -> float:
    """Tangent of the angle to the axis under which a camera in the second focus sees a ray that meets the first.

    Foci at (0, 0) and (0, -2c), a = 1: of the points on the mirror around the first one, |P F'| - |P F| = 2a.
    """
    c = eccentricity
    away = (c * c - 1.0) / (1.0 - c * np.sin(elevation))
    point = away * np.array([np.cos(elevation), np.sin(elevation)])
    to_camera = np.array([0.0, -2.0 * c]) - point
    normal = to_camera / np.hypot(*to_camera) - (-point) / away  # gradient of |P F'| - |P F|, turned round
    normal /= np.hypot(*normal)
    ray = -point / away  # from the world, toward the first focus
    out = ray - 2.0 * (ray @ normal) * normal
    np.testing.assert_allclose(out, to_camera / np.hypot(*to_camera), atol=1e-9)
    return float(point[0] / (point[1] + 2.0 * c))


@given(eccentricity=eccentricities, first=elevations, second=elevations)
def test_rays_appear_where_a_hyperboloid_reflects_them(eccentricity: float, first: float, second: float) -> None:
    mirror = Mirror.fitted(eccentricity, 10.0, 225.0)
    radii = mirror.radius(np.array([first, second]))
    through_glass = np.array([reflected(eccentricity, e) for e in (first, second)])
    if min(1.0 / eccentricity - np.sin(first), 1.0 / eccentricity - np.sin(second)) > 0.05:  # both meet the mirror
        assert radii[0] / radii[1] == pytest.approx(through_glass[0] / through_glass[1], rel=1e-6)


@given(eccentricity=eccentricities, top=st.floats(1.0, 25.0), elevation=st.floats(-1.2, 0.3))
def test_radius_and_elevation_undo_each_other(eccentricity: float, top: float, elevation: float) -> None:
    mirror = Mirror.fitted(eccentricity, top, 225.0)
    if np.sin(elevation) < mirror.xi - 0.02 and np.sin(np.radians(top)) < mirror.xi - 0.02:
        assert mirror.elevation(mirror.radius(np.array([elevation])))[0] == pytest.approx(elevation, abs=1e-9)
        assert mirror.radius(np.array([np.radians(top)]))[0] == pytest.approx(225.0)


@settings(deadline=None)  # the first one may have to compile
@given(
    tilt=st.floats(0.001, 0.2),
    toward=angles,
    azimuth=angles,
    elevation=st.floats(-0.6, 0.3),
    sign=st.sampled_from((1.0, -1.0)),
)
def test_a_leaning_mirror_sees_what_the_rotation_says(
    tilt: float, toward: float, azimuth: float, elevation: float, sign: float
) -> None:
    mirror, turn = Mirror.fitted(1.3017, 22.0, 225.0), level_from_mirror(tilt, toward)
    axis = turn @ np.array([0.0, 0.0, 1.0])
    assert np.arccos(axis[2]) == pytest.approx(tilt, abs=1e-7)
    assert np.cos(np.arctan2(axis[1], axis[0]) - toward) == pytest.approx(1.0)
    ray = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    r = mirror.radius(np.array([elevation]))[0]
    u, v = np.array([300.0 + r * np.cos(azimuth)]), np.array([200.0 - sign * r * np.sin(azimuth)])
    found_azimuth, found_radius, own = (np.empty(1) for _ in range(3))
    seen_by(u, v, 300.0, 200.0, sign, mirror.k_px, mirror.xi, turn, found_azimuth, found_radius, own)
    level = turn @ ray
    assert own[0] == pytest.approx(r)
    assert np.cos(found_azimuth[0] - np.arctan2(level[1], level[0])) == pytest.approx(1.0, abs=1e-12)
    assert found_radius[0] == pytest.approx(mirror.radius(np.arcsin(level[2:]))[0], rel=1e-6)
