"""Two studies as pictures: how soon knocks are noticed, and what a drive of many hours leaves as it was."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omnivert.pictures.mount import INK
from omnivert.studies.charts import FILTER, LIMIT, SMOOTHER, figure_of, keyed, plain, saved, titled
from omnivert.studies.endurance import Room
from omnivert.studies.knocks import KINDS, SOON_S, Knocked
from omnivert.studies.presets import Case

TONES = dict(zip(KINDS, (FILTER, SMOOTHER, "#5b8c5a"), strict=True))
WORDS = {"yaw": "turned by 2°", "forward": "2 cm along", "left": "2 cm across"}


def write_knocks(path: Path, cases: Sequence[Case], runs: Sequence[Knocked]) -> None:
    """Share of the knocks noticed, against the time of driving since."""
    height = 4.8
    figure = figure_of((13.0, height))
    grid = figure.add_gridspec(1, len(cases), left=0.05, right=0.985, top=1.0 - 1.15 / height, bottom=0.13, wspace=0.1)
    for place, case in enumerate(cases):
        one = figure.add_subplot(grid[place])
        hits = [run for run in runs if run.case == case.name and run.is_hit]
        for kind in KINDS:
            own = [run for run in hits if run.kind == kind]
            late = np.sort([run.noticed_s for run in own if run.noticed_s is not None])
            share = 100.0 * np.arange(1, late.size + 1) / max(1, len(own))
            one.step(np.concatenate([[0.0], late, [100.0]]), [0.0, *share, *share[-1:]] if late.size else [0.0, 0.0],
                     where="post", color=TONES[kind], lw=2.2, zorder=3)  # fmt: skip
        one.axvline(SOON_S, color=LIMIT, lw=1.3, ls=(0, (4, 3)), zorder=1)
        one.set(xscale="symlog", xlim=(0.0, 100.0), ylim=(0.0, 103.0), xlabel="s of driving after the knock")
        one.set_xticks([0, 1, 3, 10, 30, 60], ["0", "1", "3", "10", "30", "60"])
        one.minorticks_off()
        one.set_title(f"{case.name}: {len(hits)} knocks", loc="left", fontsize=12, color=INK, pad=7)
        plain(one, "both")
    titled(figure, height, "How soon a knock is noticed", "% of the knocks of each kind")
    keyed(figure, height, (*((WORDS[kind], TONES[kind]) for kind in KINDS), ("3 s", LIMIT)))
    saved(figure, path)


def write_rooms(path: Path, cases: Sequence[Case], rooms: Sequence[Room]) -> None:
    """Memory, time of a solve and of a frame over the hours; alarms as marks."""
    height = 4.8
    figure = figure_of((13.0, height))
    grid = figure.add_gridspec(1, 3, left=0.05, right=0.985, top=1.0 - 1.15 / height, bottom=0.13, wspace=0.16)
    tones = dict(zip([case.name for case in cases], (FILTER, SMOOTHER), strict=True))
    parts = (
        ("memory, MB", "memory_mb"),
        ("median time of a solve, ms", "solve_median_ms"),
        ("time for a frame, ms", "frame_ms"),
    )
    for place, (title, name) in enumerate(parts):
        one = figure.add_subplot(grid[place])
        most = 1.0
        for case in cases:
            own = [room for room in rooms if room.case == case.name]
            at, value = [room.hours for room in own], [getattr(room, name) for room in own]
            one.plot(at, value, color=tones[case.name], lw=2.0, marker="o", ms=3.5, zorder=3)
            odd = [(room.hours, getattr(room, name)) for room in own if room.alarms]
            one.plot([x for x, _ in odd], [y for _, y in odd], "x", color=LIMIT, ms=10, mew=2.2, zorder=4)
            most = max([most, *value])
        one.set(ylim=(0.0, 1.15 * most), xlabel="hours driven")
        one.set_xlim(left=0.0)
        one.set_title(title, loc="left", fontsize=12, color=INK, pad=7)
        plain(one, "both")
    alarms = sum(len(room.alarms) for room in rooms)
    hours = sum(max((room.hours for room in rooms if room.case == case.name), default=0.0) for case in cases)
    titled(figure, height, "A drive of many hours", f"{hours:.1f} h in all, {alarms} false alarms")
    keyed(figure, height, (*tones.items(), ("false alarm", LIMIT)))
    saved(figure, path)
