"""What each refusal means, why it is there, and the way out: one entry for each code.

The first digit says what it is about: 1 the drive, 2 use and configuration, 3 recordings and other files, 4 the bus and
the services on it, 5 devices, 6 the store.
"""

from omnivert.cli.explain.data import DATA
from omnivert.cli.explain.drive import DRIVE
from omnivert.cli.explain.explanation import Explanation
from omnivert.cli.explain.running import RUNNING
from omnivert.cli.explain.use import USE

EXPLANATIONS: dict[str, Explanation] = {**DRIVE, **USE, **DATA, **RUNNING}
