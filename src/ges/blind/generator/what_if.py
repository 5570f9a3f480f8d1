"""What each concealed effect did along the flown path: the path flown again with it taken out.

States, rotor speeds and commands are imposed as they were recorded. Only what has a memory of its
own runs on: inflow, wake, gusts, battery, load, motors. The difference between two such replays is
the change that one effect made, whatever else is concealed beside it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ges.blind.generator.concealed import COMPANIONS, NEUTRAL, SENSOR
from ges.blind.generator.detectable import TrueFlight, body_of, detectable, driven
from ges.blind.generator.flight import (
    CONTROL,
    DT_S,
    ROTORS,
    SLOW,
    TURN_PER_M,
    Simulation,
    Sortie,
    rotation_matrix,
)
from ges.blind.generator.plan import CONTROL_DT_S
from ges.blind.generator.sensing import lagged
from ges.blind.generator.whereabouts import payload_force
from ges.blind.limit import Change
from ges.blind.noise import Air

if TYPE_CHECKING:
    from ges.blind.generator.make import Case

# numbers that are the effect's own, where it needs another effect to act on
OWN_NUMBERS = {
    "wind": ("wind_m_s",),
    "gusts": ("gust_m_s",),
    "ground_effect_forward_flight": ("image_sweep",),
    "ground_effect_lag": ("image_lag",),
    "ground_effect_moment": ("image_contrast",),
    "actuator_mapping": ("mapping",),
}
IMPOSED = ("p", "v", "q", "omega")
METHOD = "loads and rotor speeds along the path, flown again without each effect"


class _PathReplay(Simulation):
    """Sorties along recorded states; ``run`` returns loads and the rotor speeds of the drive."""

    def __init__(self, sorties: list[Sortie], book: Mapping[str, np.ndarray]) -> None:
        super().__init__(sorties, len(book["p"]))
        self.book = book

    def run(self) -> dict[str, np.ndarray]:
        """Return the loads along the recorded path.

        Returns
        -------
        ``force`` and ``moment`` beyond the nominal vehicle's, (n, 3, F), and ``speed`` (n, rotors,
        F).
        """
        n = len(self.book["p"])
        out = {k: np.empty((n, w or self.b.n_rotors, len(self.sorties))) for k, w in LOADS.items()}
        speeds = self.book["rotor_speed"] / self.b.true["speed"]
        # the drive runs on with its own speeds, while the loads are those at the recorded speeds
        own = speeds[0].copy()
        for i in range(n * CONTROL):
            k, part = i // CONTROL, i % CONTROL / CONTROL
            after = min(k + 1, n - 1)
            for name in IMPOSED:
                rows = self.book[name]
                setattr(self.s, name, rows[k] + part * (rows[after] - rows[k]))
            self.r = rotation_matrix(self.s.q)
            if i % SLOW == 0:
                self._slow(i // SLOW)
            self.u = self.book["u"][k]
            self.s.x = own
            self._motors(i)
            own = self.s.x
            self.s.x = speeds[k] + part * (speeds[after] - speeds[k])
            self.s.speed_rate = self.book["rotor_speed"][after] - self.book["rotor_speed"][k]
            self.s.speed_rate /= CONTROL * DT_S
            _, _, extra = self._loads()
            if part == 0.0:
                for name, rows in zip(LOADS, (*extra, own * self.b.true["speed"]), strict=True):
                    out[name][k] = rows
        return out


LOADS = {"force": 3, "moment": 3, "speed": ROTORS}
Flights = Sequence[Mapping[str, np.ndarray]]


def detectable_of(cases: Sequence[Case], books: Sequence[Flights]) -> list[dict]:
    """Return for every case what any method could detect of it.

    Parameters
    ----------
    cases : the cases, of vehicles with as many rotors.
    books : true flights of each case at the control rate, all of one length.

    Returns
    -------
    A case's log likelihood ratios in nats, see :func:`ges.blind.limit.log_likelihood_ratios`, and
    ``method``.
    """
    limits = []
    for case, flights, changes in zip(cases, books, _changes(cases, books), strict=True):
        flown = [_flown(*parts) for parts in zip(case.sorties, flights, changes, strict=True)]
        log = case.around.logging
        limits.append(detectable(flown, log.rate_hz, log.sensors, case.craft) | {"method": METHOD})
    return limits


def _flown(
    sortie: Sortie, flight: Mapping[str, np.ndarray], changes: Mapping[str, Change]
) -> TrueFlight:
    n = sortie.plan.reference.shape[1]
    scales = [(share * sortie.turbulence, time) for share, time in sortie.weather.scales]
    level = None if sortie.weather.usual else flight["level"][:n, 0]
    if level is None:
        scales = [(sortie.weather.strength * sd, time) for sd, time in scales]
    return TrueFlight(
        CONTROL_DT_S,
        {k: flight[k][:n] for k in ("p", "v", "q", "omega", "rotor_speed", "u")},
        {name: {c: v[:n] for c, v in one.items()} for name, one in changes.items()},
        Air(tuple(scales), TURN_PER_M, level),
    )


def _changes(cases: Sequence[Case], books: Sequence[Flights]) -> list[list[dict[str, Change]]]:
    """Return by case and flight what each name changed."""
    variants = {
        (k, label): numbers
        for k, case in enumerate(cases)
        for label, numbers in _variants(case).items()
    }
    replayed = _replayed(cases, books, variants)
    changes = []
    for k, (case, flights) in enumerate(zip(cases, books, strict=True)):
        one = {label: rows for (j, label), rows in replayed.items() if j == k}
        changes.append([_change(case, f, flights[f], one) for f in range(len(flights))])
    return changes


def _variants(case: Case) -> dict[str, dict[str, float]]:
    """Return the numbers of what is to be flown again, by name.

    Where one effect alone is concealed nothing is: all that is unusual is its doing. Else these are
    the whole, all but what acts on others, and that without each.
    """
    if len(case.names) < 2:
        return {}
    hid = {k: v for one in case.numbers.values() for k, v in one.items()}
    variants = {"whole": hid}
    dependent = [n for n in case.names if n in OWN_NUMBERS]
    # what acts on others is judged with them on, the others among themselves without it
    base = _neutral(hid, [number for n in dependent for number in OWN_NUMBERS[n]])
    variants |= {n: _neutral(hid, OWN_NUMBERS[n]) for n in dependent}
    variants["base"] = base
    for name in [n for n in case.names if n not in dependent]:
        variants[name] = _neutral(base, _numbers_of(case, name))
    return variants


def _numbers_of(case: Case, name: str) -> list[str]:
    """Return the numbers of an effect, also of one that came with another."""
    prerequisites = [n for n in case.numbers if n == name or name in COMPANIONS.get(n, ())]
    return [k for n in prerequisites for k in case.numbers[n] if k not in OWN_NUMBERS.get(n, ())]


def _neutral(hid: Mapping[str, float], numbers: Sequence[str]) -> dict[str, float]:
    return {k: NEUTRAL[k] if k in numbers else v for k, v in hid.items()}


def _replayed(
    cases: Sequence[Case],
    books: Sequence[Flights],
    variants: Mapping[tuple[int, str], Mapping[str, float]],
) -> dict[tuple[int, str], list[dict[str, np.ndarray]]]:
    """Fly all variants of all cases abreast; return loads by variant and flight."""
    if not variants:
        return {}
    sorties: list[Sortie] = []
    recorded: list[Mapping[str, np.ndarray]] = []
    for (k, _), numbers in variants.items():
        around = cases[k].around.battery
        sorties += [replace(s, numbers={**around, **numbers}) for s in cases[k].sorties]
        recorded += books[k]
    names = (*IMPOSED, "u", "rotor_speed")
    book = {name: np.stack([flight[name] for flight in recorded], axis=-1) for name in names}
    out = _PathReplay(sorties, book).run()
    parts = iter(range(len(sorties)))
    return {
        key: [{n: v[:, :, f] for n, v in out.items()} for f in _take(parts, cases[key[0]])]
        for key in variants
    }


def _take(parts: Iterator[int], case: Case) -> list[int]:
    return [next(parts) for _ in case.sorties]


def _change(
    case: Case, f: int, flight: Mapping[str, np.ndarray], replayed: Mapping[str, list[dict]]
) -> dict[str, Change]:
    if not case.names:
        return {}
    if case.names[0] in SENSOR:
        return {case.names[0]: _reading_change(case.sorties[f], flight)}
    if not replayed:
        loads = {"force": flight["extra_force"], "moment": flight["extra_moment"]}
        speed = flight["rotor_speed"] - flight["plain_speed"]
        return {case.names[0]: _as_change(case, case.names[0], flight, loads | {"speed": speed})}
    changes = {}
    for name in case.names:
        # each name against the same flights without it alone
        whole = replayed["whole" if name in OWN_NUMBERS else "base"][f]
        off = {k: whole[k] - replayed[name][f][k] for k in LOADS}
        changes[name] = _as_change(case, name, flight, off)
    return changes


def _as_change(
    case: Case, name: str, flight: Mapping[str, np.ndarray], off: Mapping[str, np.ndarray]
) -> Change:
    """Return loads and the speeds of the drive as a change; a wrong mass or inertia is one, too."""
    change = driven(body_of(case.craft), case.craft.true, flight["rotor_speed"], off["speed"])
    change = {**change, "force_N": change["force_N"] + off["force"]}
    # J (1 + e) omega' = M: the file's J leaves a moment of -e J omega'
    excess = case.sorties[0].numbers.get("inertia_error", 1.0) - 1.0
    true = np.array([case.craft.true[k] for k in ("ixx", "iyy", "izz")])
    turning = np.gradient(flight["omega"], CONTROL_DT_S, axis=0)
    change["moment_Nm"] = change["moment_Nm"] + off["moment"] - excess * true * turning
    if name == "payload":
        change["force_N"] = change["force_N"] + payload_force(case, flight)
    return change


def _reading_change(sortie: Sortie, flight: Mapping[str, np.ndarray]) -> Change:
    """Return what a faulty sensor adds to its readings."""
    hid, n = {**NEUTRAL, **sortie.numbers}, len(flight["p"])

    def constant(*values: float) -> np.ndarray:
        return np.tile(np.array(values, dtype=float), (n, 1))

    late = hid["time_offset_s"]
    height = flight["p"][:, 2:] - flight["ground"]
    change = {
        "range_m": constant(hid["range_bias_m"]),
        "attitude_rad": constant(hid["att_bias_x_rad"], hid["att_bias_y_rad"], 0.0),
        "acceleration_m_s2": constant(*(hid[f"acc_bias_{a}_m_s2"] for a in "xyz")),
        "rate_rad_s": constant(*(hid[f"gyro_bias_{a}_rad_s"] for a in "xyz")),
        "position_m": _later(flight["p"], late) - flight["p"],
        "velocity_m_s": _later(flight["v"], late) - flight["v"],
    }
    # an attitude that is late by t is turned back by t omega
    change["attitude_rad"] = change["attitude_rad"] - late * flight["omega"]
    if hid["range_lag_s"]:
        slow = lagged(height[:, 0], hid["range_lag_s"], CONTROL_DT_S)[:, None]
        change["range_m"] = change["range_m"] + slow - height
    return change


def _later(rows: np.ndarray, by_s: float) -> np.ndarray:
    clock = np.arange(len(rows)) * CONTROL_DT_S
    return np.stack([np.interp(clock - by_s, clock, row) for row in rows.T], axis=1)
