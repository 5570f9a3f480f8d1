"""A whole run: from flight logs or a recording set to a diagnosis and its page."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from ges.diagnose.pipeline import diagnose
from ges.diagnose.prepare.split import cut
from ges.diagnose.report.diagnosis import Diagnosis
from ges.diagnose.report.drawing import Drawing
from ges.diagnose.report.figures import map_figure
from ges.diagnose.report.origin import with_files
from ges.diagnose.report.output import write_diagnosis
from ges.diagnose.types.model import from_vehicle
from ges.errors import GesError, UsageError
from ges.files import sha256, tree_hash, write_text
from ges.recordings.readers import Log, Options, find_logs, flight_names, is_log, open_log
from ges.recordings.recording import RecordingSet, load_set, make_set
from ges.vehicle.file import Vehicle
from ges.vehicle.from_log import describe_log
from ges.vehicle.load import load_vehicle, vehicle_path
from ges.vehicle.propeller import Propeller

Watch = Callable[[str], object]
MADE_VEHICLE = "vehicle.yaml"
"""The vehicle file that a run makes from its first log."""

STEPS: Mapping[str, str] = {
    "located": "looking for physics that explains it",
    "fitted": "flying again what took no part",
}
"""What goes on once a step of the pipeline has ended."""


@dataclasses.dataclass(frozen=True)
class Request:
    """What to diagnose, and what is known besides the files.

    Attributes
    ----------
    sources : folder of one recording set, or flight logs of one vehicle. A folder without
        ``vehicle.yaml`` stands for the logs in it.
    vehicle : path of a vehicle file, a name of the library, or a vehicle. By default a set's own;
        for logs one is made from the first.
    mass_kg : mass as flown, for a vehicle made from a log.
    prop : size of the propellers, as ``10x4.5``, for a vehicle made from a log.
    wheelbase_m : distance of opposite hubs, m, for a vehicle made from a log; by default that of
        the log or of usual vehicles.
    layout : order and spins of the motors, as ``x`` or ``hexa-x``, where the log lacks them.
    holdout : names of flights that take no part; if empty, :func:`~ges.diagnose.pipeline.diagnose`
        chooses.
    options, kind : how logs are read, see :func:`ges.recordings.readers.open_log`.
    mends : corrections of columns, see :func:`ges.recordings.recording.make_set`.
    command : command line that the page shows; '' for none.

    Examples
    --------
    >>> from ges.diagnose.run import Request
    >>> request = Request(sorted(example.glob("runs_*.parquet")), example / "vehicle.yaml")
    >>> [path.name for path in request.sources]
    ['runs_fast.parquet', 'runs_slow.parquet']
    """

    sources: Sequence[Path]
    vehicle: Vehicle | str | Path | None = None
    mass_kg: float | None = None
    prop: str | None = None
    wheelbase_m: float | None = None
    layout: str | None = None
    holdout: Sequence[str] = ()
    options: Options = dataclasses.field(default_factory=Options)
    kind: str = "auto"
    mends: Sequence[str] = ()
    command: str = ""


@dataclasses.dataclass(frozen=True)
class Inputs:
    """Flights ready to be diagnosed, with the origin of each.

    Attributes
    ----------
    recordings : checked flights with their vehicle.
    hashes : SHA-256 of the file of each flight, by name of the flight.
    vehicle_file : ``file`` and ``sha256`` of the vehicle file.
    made : text of a vehicle file that was made from a log; '' where one was given.
    """

    recordings: RecordingSet
    hashes: Mapping[str, str]
    vehicle_file: Mapping[str, str]
    made: str = ""


def run(
    request: Request,
    out: Path,
    drawing: Drawing | None = None,
    watch: Watch = len,
    page: bool = True,
) -> Diagnosis:
    """Read flights, diagnose them and write the files of the diagnosis.

    Parameters
    ----------
    request : what to diagnose.
    out : folder for the files, made where it is missing.
    drawing : figures drawn by other processes; by default they are drawn in this one.
    watch : called with a few words when a step begins.
    page : whether report.html and its figures are written.

    Returns
    -------
    The diagnosis, whose ``origin`` names the files.

    Raises
    ------
    GesError
        When the request, a log or the vehicle cannot be used, in one sentence.
    OSError
        When a file cannot be written.

    Examples
    --------
    >>> from ges.diagnose.run import run
    >>> again = run(request, Path("report"), page=False)
    >>> sorted(path.name for path in Path("report").iterdir())
    ['diagnosis.json', 'residuals.parquet', 'vehicle.fitted.yaml']
    """
    inputs = gather_inputs(request, watch)

    def ended(step: str, results: Sequence) -> None:
        if step == "located" and drawing:
            drawing.start(map_figure(results))
        watch(STEPS[step])

    watch("finding when it flies, and where the simulator differs")
    diagnosis = diagnose(inputs.recordings, holdout=list(request.holdout) or None, watch=ended)
    # only now: nothing that diagnoses knows a file or a command
    origin = with_files(diagnosis.origin, inputs.hashes, inputs.vehicle_file, request.command)
    diagnosis = dataclasses.replace(diagnosis, origin=origin)
    watch("writing the page" if page else "writing")
    if inputs.made:
        write_text(out / MADE_VEHICLE, inputs.made)
    write_diagnosis(diagnosis, out, inputs.recordings.folder, drawing, page)
    return diagnosis


def gather_inputs(request: Request, watch: Watch = len) -> Inputs:
    """Read and check the flights of a request; a single log is cut into several.

    Parameters
    ----------
    request : what to diagnose.
    watch : called with a few words when a step begins.

    Raises
    ------
    GesError
        When the request, a log or the vehicle cannot be used, in one sentence.
    """
    first, *rest = request.sources
    # a folder may be a log itself: a ROS 2 bag is one
    if not rest and (first / "vehicle.yaml").exists() and not is_log(first):
        return _of_set(request, first, watch)
    return _of_logs(request, watch)


def _of_set(request: Request, folder: Path, watch: Watch) -> Inputs:
    asked = {"mass": request.mass_kg, "prop": request.prop, "layout": request.layout}
    asked["wheelbase"] = request.wheelbase_m
    asked |= dataclasses.asdict(request.options)
    asked["format"] = None if request.kind == "auto" else request.kind
    # an option that would change nothing is a mistake of somebody who expects it to
    for option in (name for name, value in asked.items() if value is not None):
        raise UsageError(
            f"{option} is said of logs; {folder} is a recording set, whose columns are named and"
            " which has its vehicle.yaml (--vehicle names another)"
        )
    watch(f"reading {folder}")
    recordings, path = load_set(folder, mends=request.mends), folder / "vehicle.yaml"
    vehicle_file = {"file": path.name, "sha256": sha256(path)}
    if request.vehicle:
        vehicle, vehicle_file, place = _given_vehicle(request.vehicle)
        # checked anew: so far it was against the set's own vehicle
        named = [(f.name, f.frame) for f in recordings.flights]
        recordings = make_set(vehicle, named, place)
    hashes = {f.name: sha256(folder / f"{f.name}.parquet") for f in recordings.flights}
    return Inputs(recordings, hashes, vehicle_file)


def _of_logs(request: Request, watch: Watch) -> Inputs:
    logs, refused = _open_logs(request, watch)
    vehicle, vehicle_file, folder, made, remarks = _vehicle(request, logs)
    flights = {name: (path, log.frame()) for name, (path, log) in logs.items()}
    notes = [
        *refused,
        *remarks,
        *(f"{n}: {note}" for n, (_, log) in logs.items() for note in log.notes),
    ]
    named = [(name, frame) for name, (_, frame) in flights.items()]
    hashes = {name: _hash(path) for name, (path, _) in flights.items()}
    # something has to be held out, and a single log has no other flight
    if len(named) == 1:
        watch("cutting the log into flights")
        (whole, frame), (digest,) = named[0], hashes.values()
        named = cut(whole, frame, from_vehicle(vehicle, folder))
        # every part comes of the same file
        hashes = {name: digest for name, _ in named}
        notes.append(
            f"{whole} is the only log, so it was cut into {len(named)} flights; what is held out"
            " shares battery, trim and weather with the rest, and another flight would prove more"
        )
    recordings = make_set(vehicle, named, folder, request.mends)
    recordings = dataclasses.replace(recordings, warnings=(*notes, *recordings.warnings))
    return Inputs(recordings, hashes, vehicle_file, made)


def _open_logs(request: Request, watch: Watch) -> tuple[dict[str, tuple[Path, Log]], list[str]]:
    """Return logs by name of their flight with their files, and why others cannot serve."""
    logs, refused = {}, []
    paths = find_logs(request.sources)
    for name, path in flight_names(paths).items():
        watch(f"reading {path.name}")
        try:
            log = open_log(path, request.options, request.kind)
        except GesError as error:
            # what lies beside the logs of a folder may be no log; what was named has to be one
            if path in request.sources:
                raise
            refused.append(f"{name} was left out: {error}")
            continue
        problem = log.problem()
        # of many logs a bad one is left out; a single one is all there is
        if problem and len(paths) == 1:
            raise GesError(f"{path.name}: {problem}")
        if problem:
            refused.append(f"{name} was left out: {problem}")
        else:
            logs[name] = (path, log)
    if not logs:
        raise GesError(f"none of the {len(paths)} logs can serve: {refused[0]}")
    return logs, refused


def _vehicle(
    request: Request, logs: Mapping[str, tuple[Path, Log]]
) -> tuple[Vehicle, dict[str, str], Path, str, Sequence[str]]:
    """Return vehicle, its file and hash, and the folder of its height map.

    For one made from the first log also its text and remarks.
    """
    if request.vehicle:
        return *_given_vehicle(request.vehicle), "", ()
    if request.mass_kg is None or request.prop is None:
        raise UsageError(
            "a log does not say what the vehicle weighs and what propellers it has; give --mass KG"
            " and --prop SIZE, or --vehicle NAME|FILE ('ges vehicle --list' has names)"
        )
    # all logs are of one vehicle, so any would do
    log = next(log for _, log in logs.values())
    prop = Propeller.parse(request.prop)
    sheet = describe_log(
        log,
        request.mass_kg,
        prop,
        layout=request.layout,
        wheelbase_m=request.wheelbase_m,
        name=log.name,
    )
    return sheet.vehicle, {"file": MADE_VEHICLE}, Path("."), sheet.to_yaml(), sheet.remarks


def _given_vehicle(given: Vehicle | str | Path) -> tuple[Vehicle, dict[str, str], Path]:
    """Return a vehicle, its file and hash, and the folder of its height map."""
    if isinstance(given, Vehicle):
        return given, {"file": given.name}, Path(".")
    path = vehicle_path(given)
    return load_vehicle(path), {"file": path.name, "sha256": sha256(path)}, path.parent


def _hash(path: Path) -> str:
    if path.is_dir():
        return tree_hash(path, (p for p in path.rglob("*") if p.is_file()))
    return sha256(path)
