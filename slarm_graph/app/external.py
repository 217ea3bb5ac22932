# SPDX-FileCopyrightText: 2026 slarm-graph contributors
# SPDX-License-Identifier: Apache-2.0
"""Results of other systems in a comparison, evaluated from their files like ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from slarm_graph.app.map_images import save_map
from slarm_graph.app.outcomes import recorded_metrics
from slarm_graph.app.outputs import save_metrics, save_trajectory
from slarm_graph.app.run_folder import RunFolder, recorded_laser
from slarm_graph.app.trials import Trial, TrialSource
from slarm_graph.errors import BadInput
from slarm_graph.eval.assessment import assess, read_references
from slarm_graph.eval.comparison import Outcome
from slarm_graph.eval.metric_parts import Subject
from slarm_graph.eval.plane_of_motion import level
from slarm_graph.files.maps import masks_of, read_map
from slarm_graph.files.trajectories import read_spatial, trajectory_file
from slarm_graph.geometry import Pose2


@dataclass(frozen=True, slots=True)
class External:
    """A result of another system.

    Parameters
    ----------
    name : str
        Name in the tables.
    source : TrialSource
    trajectory : Path
    map_file : Path, optional
    """

    name: str
    source: TrialSource
    trajectory: Path
    map_file: Path | None = None


def find_externals(given: Sequence[str], sources: Sequence[TrialSource]) -> tuple[External, ...]:
    """Read `NAME=FILE[,MAP]`, with several sources `NAME@SOURCE=FILE[,MAP]`.

    Raises
    ------
    BadInput
        When one has another form, or a file is missing.
    """
    return tuple(_find(words, sources) for words in given)


def _find(words: str, sources: Sequence[TrialSource]) -> External:
    left, _, files = words.partition("=")
    name, _, wanted = left.partition("@")
    fitting = [
        s for s in sources if wanted in ("", Path(s.place).name, Path(s.place).name.split(".")[0])
    ]
    if not name or not files or len(fitting) != 1:
        names = ", ".join(Path(s.place).name for s in sources)
        raise BadInput(f"--external {words}: expected NAME=TRAJECTORY[,MAP], with several sources"
                       f" NAME@SOURCE=TRAJECTORY[,MAP]; sources are {names}")  # fmt: skip
    paths = [Path(file) for file in files.split(",")]
    for path in paths:
        if not path.exists():
            raise BadInput(f"--external {words}: no such file: {path}")
    map_file = paths[1] if len(paths) > 1 else None
    return External(name, fitting[0], trajectory_file(paths[0]), map_file)


def measure(external: External, folder: Path, trials: Sequence[Trial]) -> Outcome:
    """Evaluate a result against its source's references and store it like a run.

    Parameters
    ----------
    external : External
    folder : Path
        Folder of the comparison.
    trials : sequence of Trial
        Finished runs of ours, which record the pose of the laser.
    """
    truth = external.source.truth
    place = Path(external.source.place).name
    target = folder / f"{place.split('.')[0]}_{external.name}_external"
    target.mkdir(parents=True, exist_ok=True)
    run = RunFolder(target)
    trajectory = level(read_spatial(external.trajectory))
    references = read_references(truth.ground_truth, truth.relations)
    laser = _laser(external.source, trials)
    metrics = assess(Subject(trajectory, references, laser))
    save_trajectory(run, "trajectory", trajectory)
    if external.map_file is not None:
        grid = read_map(external.map_file)
        save_map(run, "map", grid.geometry, masks_of(grid))
    save_metrics(run, metrics)
    run.note(status="ok", external=str(external.trajectory.resolve()))
    figures = recorded_metrics(target)
    return Outcome(place, external.name, 0, "ok", folder=target.name, figures=figures)


def _laser(source: TrialSource, trials: Sequence[Trial]) -> Pose2:
    """Return `robot_from_laser` as recorded by a run on the same source; else identity."""
    lasers = (recorded_laser(trial.folder) for trial in trials if trial.source == source)
    return next((laser for laser in lasers if laser is not None), Pose2())
