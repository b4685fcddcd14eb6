"""What stands where around a camera, against rays that are cut with everything, one by one."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from omnivert.simulation.columns import columns, nearest, wrapped
from omnivert.simulation.surfaces import Look, Panel, Round, surfaces

Array = NDArray[np.float64]
LOOK = Look(0.5)
coordinate = st.floats(-6.0, 6.0)
points = st.tuples(coordinate, coordinate)
panels = st.builds(lambda a, b: Panel(a, b, 0.0, 2.0, LOOK), points, points)
rounds = st.builds(lambda at, r: Round(at, r, 0.0, 2.0, LOOK), points, st.floats(0.05, 0.8))


def by_hand(things: list[Panel | Round], origin: Array, direction: Array) -> float:
    """Distance along a ray to the nearest of the things; 0 when it meets none."""
    found = []
    for thing in things:
        if isinstance(thing, Panel):
            start, along = np.array(thing.start), np.array(thing.end) - thing.start
            if abs(np.linalg.det(np.stack([direction, -along], axis=1))) < 1e-12:
                continue
            far, share = np.linalg.solve(np.stack([direction, -along], axis=1), start - origin)
            found += [far] if 0.0 <= share <= 1.0 and far > 0.0 else []
        else:
            off = origin - thing.at
            if off @ off <= (1.001 * thing.radius_m) ** 2:
                continue
            roots = np.roots(np.array([1.0, 2.0 * float(off @ direction), float(off @ off) - thing.radius_m**2]))
            found += [float(root.real) for root in roots if abs(root.imag) < 1e-12 and root.real > 0.0]
    return min(found, default=0.0)


@settings(max_examples=20, deadline=None)  # the first one may have to compile
@given(flat=st.lists(panels, max_size=8), round_=st.lists(rounds, max_size=4), heading=st.floats(-7.0, 7.0))
def test_each_column_holds_what_a_ray_through_it_meets(flat: list[Panel], round_: list[Round], heading: float) -> None:
    things, _ = surfaces(flat, round_)
    around = columns(things.place, things.flat, 0.2, -0.1, heading)
    middle = 0.5 * (around.bounds[1:] + around.bounds[:-1])
    some = np.flatnonzero(np.diff(around.bounds) > 1e-6)[::13]
    told = nearest(around, things.heights, middle[some], 1.0)
    for azimuth, far in zip(middle[some], told, strict=True):
        ray = np.array([np.cos(azimuth + heading), np.sin(azimuth + heading)])
        np.testing.assert_allclose(far, by_hand([*flat, *round_], np.array([0.2, -0.1]), ray), rtol=1e-6, atol=1e-6)


@settings(deadline=None)
@given(flat=st.lists(panels, max_size=8), heading=st.floats(-7.0, 7.0))
def test_every_end_of_a_panel_is_a_border_between_columns(flat: list[Panel], heading: float) -> None:
    things, edges = surfaces(flat, [])
    around = columns(things.place, things.flat, 0.2, -0.1, heading)
    assert np.all(np.diff(around.bounds) >= 0.0)
    assert (around.bounds[0], around.bounds[-1]) == (-np.pi, np.pi)
    place_of = {edge.line_id: (edge.x_m, edge.y_m) for edge in edges}
    for line, bound, panel in zip(
        things.line.ravel(), around.end.ravel(), np.repeat(np.arange(len(flat)), 2), strict=True
    ):
        if bound >= 0:
            ends = np.array([flat[panel].start, flat[panel].end]) - (0.2, -0.1)
            azimuths = np.arctan2(ends[:, 1], ends[:, 0]) - heading
            off = np.cos(azimuths - around.bounds[bound])
            assert off.max() > 1.0 - 1e-12
            assert (
                np.hypot(*(np.asarray(place_of[int(line)], dtype=np.float64) - (0.2, -0.1) - ends[off.argmax()])) < 2e-3
            )


@settings(deadline=None)
@given(st.floats(-100.0, 100.0))
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    assert -np.pi <= wrapped(angle) < np.pi
    assert np.cos(wrapped(angle) - angle) > 1.0 - 1e-9
