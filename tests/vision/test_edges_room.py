"""The busiest picture there can be: of every four pixels three are edge points."""

import subprocess
import sys

# Found by trying changes of a pixel at random. Four of four cannot be: each would have to exceed the next around.
BUSIEST = """
import numpy as np
from omnivert.vision.edges import everywhere, thinned_edges
tile = [[93, 163, 130, 69], [108, 82, 59, 50], [130, 213, 129, 76], [159, 208, 180, 166]]
grey = np.tile(np.array(tile, dtype=np.uint8), (60, 80))
for _ in range(3):
    edges = thinned_edges(grey, everywhere(grey), 32.0)
print(edges.u_px.size, all(np.all(np.isfinite(values)) for values in edges))
"""


def test_there_is_room_for_the_edge_points_of_any_picture() -> None:
    """In a process of its own: what is written beyond the room may end it."""
    told = subprocess.run([sys.executable, "-c", BUSIEST], capture_output=True, text=True, timeout=100, check=False)
    assert told.returncode == 0
    assert told.stdout.split() == [str(3 * (236 // 2) * (316 // 2)), "True"]
