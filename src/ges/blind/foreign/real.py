"""Labelled real flights as sets: what the file does not know, or what was done to the vehicle since
it was calibrated.

Conditions go to development and evaluation in turn, in the order of their names. What any method
could tell of them is not known: nobody has their noise-free truth.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ges.blind.foreign.sets import HALVES, Concealed, Place, Sources, write_recorded
from ges.diagnose.calibrate.calibrate import calibrate
from ges.errors import GesError
from ges.recordings.readers import Options, open_log
from ges.recordings.recording import make_set
from ges.vehicle.file import Quantity, Vehicle, vehicle_content
from ges.vehicle.load import load_vehicle

CRAZYPAD, IMRCLAB, APPIUS = "crazypad", "imrclab-crazyflie", "appius"
FOLDERS = {CRAZYPAD: "crazypad", IMRCLAB: "imrclab-crazyflie", APPIUS: "appius-ground-effect"}
LIMIT = "not known of real flights"
HEALTHY = {
    "E8": ("E8_log00", "E8_log01", "E8_log02", "E8_log03"),
    "E9": ("E9_log00", "E9_log01", "E9_log02", "E9_log04"),
}
REFERENCES = (
    "cut_propellers_M2_0.5mm_M1_0.5mm_reference",
    "cut_propellers_M2_0.5mm_reference",
)
# a blade that was cut or taped has another torque as well; flights of the old healthy vehicle do
# not serve for the cut pairs, since rotor 3 of that series was changed without a label
CUT_PAIR = Concealed(
    ("weak_rotor",),
    "strong",
    optional=("torque_coefficient",),
    places={"weak_rotor": ("rotor 1", "rotor 2")},
)
CUT = Concealed(
    ("weak_rotor",),
    "strong",
    optional=("torque_coefficient",),
    places={"weak_rotor": ("rotor 3",)},
)
TAPED_WEIGHT = Concealed(
    ("cg_offset", "thrust_scale"), "strong", optional=("inertia",), instead=(("cg_offset",),)
)
# the thread hangs near motor 3, so that its weight shifts the balance, too
STRING_WEIGHT = Concealed(("slung_load",), "strong", optional=("cg_offset", "thrust_scale"))
# airframe, number of the first of three flights, label
CONDITIONS: Mapping[str, tuple[str, int, Concealed]] = {
    "add_weight_W1_near_M3": ("E9", 4, TAPED_WEIGHT),
    "cut_propeller_M3_1mm": ("E8", 1, CUT),
    "cut_propeller_M3_3mm": ("E9", 0, CUT),
    "cut_propellers_M2_2mm_M1_2mm": ("E9", 3, CUT_PAIR),
    "cut_propellers_M2_4mm_M1_4mm": ("E9", 3, CUT_PAIR),
    "cut_propellers_M2_6mm_M1_6mm": ("E9", 3, CUT_PAIR),
    "tape_on_propeller_M3": ("E8", 0, CUT),
    "weight_on_string_W3_near_M3": ("E8", 0, STRING_WEIGHT),
}
# free flights and flights with 4.7 g on a cable, by speed; the vehicle itself is 2.7 g heavier then
FREE = {"1.0": (0, 1, 2, 3, 4), "0.7": (17, 18, 19, 20, 21)}
PAYLOAD = {"1.0": (6, 7, 8, 9, 10), "0.7": (22, 24, 26, 27, 28), "sideways": (57, 58, 59, 60, 61)}
# what every rotor does and no calibration gives a file: where forces are logged, to name it is no
# mistake
EVERY_ROTOR = ("rotor_drag", "axial_inflow", "thrust_scale")
CABLE = Concealed(
    ("slung_load", "thrust_scale"),
    "strong",
    optional=("cg_offset", *EVERY_ROTOR),
    instead=(("slung_load",),),
)
FREE_MASS_KG = Quantity(value=0.037, sd=0.0004)
NEAR = Concealed(("ground_effect",), "medium", optional=EVERY_ROTOR)
HEALTHY_FLIGHTS = Concealed(severity="weak")
ROTORS_ALONE = Concealed(severity="weak", optional=EVERY_ROTOR)


@dataclass(frozen=True)
class RecordedDesign:
    """A set of recorded flights.

    Attributes
    ----------
    reference : flights that the vehicle is calibrated on, by path in the data set; without any the
        file stays as it is.
    flights : flights to be diagnosed, by path in the data set.
    truth : the label.
    about : condition, in words.
    pieces : number of parts that each flight is cut into.
    """

    reference: tuple[str, ...]
    flights: tuple[str, ...]
    truth: Concealed
    about: str
    pieces: int = 1

    @property
    def key(self) -> str:
        """Name in the table of cases: condition, flights, and what they are calibrated on."""
        against = f" against {' '.join(self.reference)}" if self.reference else ""
        return f"{self.about}: {' '.join(self.flights)}{against}"


def _of_half(items: Sequence, half: str) -> list:
    return list(items)[HALVES.index(half) :: 2]


def crazypad_designs(half: str) -> list[RecordedDesign]:
    """Return the sets of the crazypad flights for a half.

    Returns
    -------
    Healthy flights against other healthy flights, then changed ones against healthy ones of the
    same airframe and session. Conditions go to the halves in turn.
    """
    listed = []
    for airframe in _of_half(sorted(HEALTHY), half):
        every = [f"normal_flight/{name}" for name in HEALTHY[airframe]]
        for pair in itertools.combinations(every, 2):
            rest = tuple(name for name in every if name not in pair)
            listed.append(RecordedDesign(rest, pair, HEALTHY_FLIGHTS, f"healthy {airframe}"))
    for folder in _of_half(sorted(CONDITIONS), half):
        airframe, start, truth = CONDITIONS[folder]
        healthy = tuple(f"normal_flight/{name}" for name in HEALTHY[airframe])
        references = [healthy]
        # either reference series alone, and both as two sessions
        if truth == CUT_PAIR:
            each = [tuple(f"{ref}/E9_log0{k}" for k in range(3)) for ref in REFERENCES]
            references = [*each, each[0] + each[1]]
        logs = [f"{folder}/{airframe}_log0{start + k}" for k in range(3)]
        listed += [
            RecordedDesign(reference, pair, truth, folder)
            for reference in references
            for pair in itertools.combinations(logs, 2)
        ]
    return listed


def imrclab_designs(half: str) -> list[RecordedDesign]:
    """Return the sets of the IMRCLab flights for a half.

    Returns
    -------
    Free flights against other free flights, then flights with a payload against free ones. The
    halves differ in the speed of the flights.
    """
    speed = {"development": "1.0", "evaluation": "0.7"}[half]
    free = [f"free/eckart{k:02d}" for k in FREE[speed]]
    listed = [
        RecordedDesign(tuple(free[:3]), tuple(free[3:]), ROTORS_ALONE, "free"),
        RecordedDesign(tuple(free[2:]), tuple(free[:2]), ROTORS_ALONE, "free"),
    ]
    for kind in (speed,) if half == "development" else (speed, "sideways"):
        loaded = [f"payload/eckart{k:02d}" for k in PAYLOAD[kind]]
        listed += [
            RecordedDesign(tuple(free), tuple(part), CABLE, f"payload {kind}")
            for part in (loaded[:2], loaded[2:], loaded)
        ]
    return listed


def appius_designs(half: str) -> list[RecordedDesign]:
    """Return the sets of Appius' flights for a half, without any calibration.

    Returns
    -------
    Flights near the ground, and for development one far from it in two pieces.
    """
    if half == "development":
        return [
            RecordedDesign((), ("HOVERING.csv", "VERTICAL_SPEEDS.csv"), NEAR, "near the ground"),
            RecordedDesign(
                (), ("HIGH_ALTITUDE_V_050.csv",), ROTORS_ALONE, "far from the ground", pieces=2
            ),
        ]
    near = ("NO_COMPENSATION_V_050.csv",)
    return [
        RecordedDesign((), (*near, "HIGH_ALTITUDE_V_050.csv"), NEAR, "near and far"),
        RecordedDesign((), near, NEAR, "near the ground", pieces=2),
        RecordedDesign((), (*near, "VERTICAL_SPEEDS.csv"), NEAR, "near the ground"),
    ]


def maker(world: str) -> Callable[..., None]:
    """Return the function that writes the sets of one of these worlds.

    Parameters
    ----------
    world : :data:`CRAZYPAD`, :data:`IMRCLAB` or :data:`APPIUS`.

    Returns
    -------
    A function of the folder, the sets and the sources, like ``make`` of the other worlds. It raises
    GesError where a recording is missing.
    """

    def make(
        out: Path, sets: Sequence[tuple[RecordedDesign, int, Place]], sources: Sources
    ) -> None:
        for design, _, place in sets:
            _make(out, world, design, place, sources)

    return make


def _make(out: Path, world: str, design: RecordedDesign, place: Place, sources: Sources) -> None:
    root = sources.recordings / FOLDERS[world]
    vehicle = _vehicle(world)
    flights = [piece for name in design.flights for piece in _pieces(world, root / name, design)]
    if design.reference:
        vehicle = _calibrated(world, vehicle, root, design.reference)
    about = {"design": design.key, "vehicle": vehicle.name, "noise": "real"}
    truth, content = design.truth.truth(), vehicle_content(vehicle)
    write_recorded(out, place, content, flights, truth, LIMIT, about)


def _vehicle(world: str) -> Vehicle:
    if world == APPIUS:
        return load_vehicle("appius")
    vehicle = load_vehicle("crazyflie-2.1")
    if world == IMRCLAB:
        return vehicle.model_copy(update={"mass_kg": FREE_MASS_KG})
    return vehicle


def _calibrated(world: str, vehicle: Vehicle, root: Path, reference: Sequence[str]) -> Vehicle:
    """Calibrated as the owner of the flights would, to whom a folder is a session."""
    sessions = [
        make_set(
            vehicle, [(f"flight_{k}", _frame(world, root / n)) for k, n in enumerate(names, 1)]
        )
        for _, names in itertools.groupby(reference, key=lambda name: name.split("/")[0])
    ]
    return calibrate(*sessions).vehicle


def _pieces(world: str, path: Path, design: RecordedDesign) -> list[pd.DataFrame]:
    frame = _frame(world, path)
    size = len(frame) // design.pieces
    return [frame.iloc[k * size : (k + 1) * size] for k in range(design.pieces)]


def _frame(world: str, path: Path) -> pd.DataFrame:
    if not path.exists():
        raise GesError(
            f"the recording {path.name} is not in {path.parent}; 'ges recordings fetch' gets the"
            " published flights"
        )
    frame = open_log(path, Options("appius" if world == APPIUS else None)).frame()
    if world == IMRCLAB:
        # their commands are duty cycles after battery compensation; their rotor speeds are measured
        frame = frame[[c for c in frame.columns if not c.startswith("u_")]]
    return frame
