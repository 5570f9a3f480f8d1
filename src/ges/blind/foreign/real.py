"""Real flights as concealed cases: what the file does not know, or what was done to the vehicle
since it was calibrated.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from ges.blind.protocol import seal
from ges.diagnose.calibrate.calibrate import calibrate
from ges.errors import GesError, UsageError
from ges.files import write_json
from ges.recordings.readers import Options, open_log
from ges.recordings.recording import make_set, write_set
from ges.vehicle.file import Vehicle, load_vehicle

Flights = dict[str, pd.DataFrame]
_AS_LOGGED = Options()
APPIUS_NEAR = ("HOVERING", "VERTICAL_SPEEDS", "NO_COMPENSATION_V_050", "HIGH_ALTITUDE_V_050")
APPIUS_HIGH = "HIGH_ALTITUDE_V_050"
HEALTHY = {
    "E8": ("E8_log00", "E8_log01", "E8_log02", "E8_log03"),
    "E9": ("E9_log00", "E9_log01", "E9_log02", "E9_log04"),
}


@dataclass(frozen=True)
class Change:
    """Flights of an airframe after something was done to it, and what that is in the contract's
    names.
    """

    folder: str
    airframe: str
    names: tuple[str, ...]
    severity: str
    also: tuple[tuple[str, ...], ...] = ()


# the weight on a thread hangs near motor 3, so that it shifts the balance too; a taped weight is
# more mass and a shift
CHANGES = (
    Change("cut_propeller_M3_1mm", "E8", ("weak_rotor",), "weak"),
    Change("cut_propeller_M3_3mm", "E9", ("weak_rotor",), "strong"),
    Change(
        "tape_on_propeller_M3",
        "E8",
        ("weak_rotor",),
        "weak",
        (("weak_rotor", "torque_coefficient"),),
    ),
    Change(
        "add_weight_W1_near_M3", "E9", ("cg_offset", "thrust_scale"), "strong", (("cg_offset",),)
    ),
    Change(
        "weight_on_string_W3_near_M3",
        "E8",
        ("slung_load",),
        "strong",
        (("slung_load", "cg_offset"),),
    ),
)


def make_real(out: Path, recordings: Path) -> int:
    """Write the published flights as sealed cases; return their number.

    Parameters
    ----------
    out : folder of the cases.
    recordings : folder of the published recordings.

    Raises
    ------
    UsageError
        When a recording is not there, or ``out`` already holds sealed cases.
    """
    if (out / "sealed" / seal.SUMS).exists():
        raise UsageError(f"'{out}' already holds sealed cases; name an empty folder")
    (out / "sealed").mkdir(parents=True, exist_ok=True)
    count = 0
    for vehicle, flights, truth in (*_appius(recordings), *_crazypad(recordings)):
        identity = hashlib.sha256(repr((sorted(flights), truth["category"])).encode()).hexdigest()[
            :12
        ]
        write_set(out / "cases" / identity, vehicle, list(_numbered(flights).items()))
        write_json(out / "sealed" / f"{identity}.json", truth)
        count += 1
    seal.close(out)
    return count


def _numbered(flights: Mapping[str, pd.DataFrame]) -> Flights:
    return {f"flight_{k}": frame for k, frame in enumerate(flights.values(), 1)}


def _truth(
    category: str, verdict: str, names: tuple[str, ...], severity: str, about: str, also=()
) -> dict:
    return {
        "verdict": verdict,
        "findings": [{"name": n, "parameters": {}} for n in names],
        "severity": severity,
        "also_acceptable": [list(a) for a in also],
        "category": category,
        "situation": {"about": about},
    }


def _appius(recordings: Path):
    """The near-ground flights with a file that knows no ground effect, and one flight far from the
    ground in two halves.

    The file knows neither the drag nor the heave damping that every rotor has: to name these as
    well is no mistake.
    """
    vehicle = load_vehicle("appius")
    flights = {
        name: _frame(recordings / "appius-ground-effect" / f"{name}.csv", Options("appius"))
        for name in APPIUS_NEAR
    }
    also = (
        ("ground_effect", *more)
        for more in (("rotor_drag",), ("axial_inflow",), ("rotor_drag", "axial_inflow"))
    )
    yield (
        vehicle,
        flights,
        _truth(
            "single",
            "physics",
            ("ground_effect",),
            "medium",
            "1.5 kg quadrotor near the ground",
            also,
        ),
    )
    high = flights[APPIUS_HIGH]
    half = len(high) // 2
    halves = {"first": high.iloc[:half], "second": high.iloc[half:]}
    yield (
        vehicle,
        halves,
        _truth("null", "nothing_proven", (), "weak", "1.5 kg quadrotor far from the ground"),
    )


def _crazypad(recordings: Path):
    """Healthy flights against other healthy flights, and changed ones against all healthy flights
    of the airframe.
    """
    generic = load_vehicle("crazyflie-2.1")
    root = recordings / "crazypad"
    for airframe, names in HEALTHY.items():
        healthy = {n: _frame(root / "normal_flight" / n) for n in names}
        for part in (names[:2], names[2:]):
            known = _calibrated(generic, {n: f for n, f in healthy.items() if n not in part})
            rest = {n: healthy[n] for n in part}
            yield (
                known,
                rest,
                _truth(
                    "null",
                    "nothing_proven",
                    (),
                    "weak",
                    f"27 g quadrotor {airframe}, healthy {part[0]}",
                ),
            )
        known = _calibrated(generic, healthy)
        for change in (c for c in CHANGES if c.airframe == airframe):
            paths = sorted(_there(root / change.folder).iterdir())
            flights = {f"{change.folder}/{p.name}": _frame(p) for p in paths}
            category = "single" if len(change.names) == 1 else "pair"
            yield (
                known,
                flights,
                _truth(
                    category, "physics", change.names, change.severity, change.folder, change.also
                ),
            )


def _calibrated(vehicle: Vehicle, flights: Flights) -> Vehicle:
    return calibrate(make_set(vehicle, list(flights.items()))).vehicle


def _frame(path: Path, options: Options = _AS_LOGGED) -> pd.DataFrame:
    return open_log(_there(path), options).frame()


def _there(path: Path) -> Path:
    if not path.exists():
        raise GesError(
            f"the recording {path.name} is not in {path.parent}; 'ges recordings fetch' gets the"
            " published flights"
        )
    return path
