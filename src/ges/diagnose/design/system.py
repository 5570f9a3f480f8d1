"""The linear system of a diagnosis: residuals and columns of every flight."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from ges.diagnose.design.columns import (
    DesignColumn,
    Nuisance,
    column_parts,
    evaluate_columns,
    fly_drives_of_columns,
    nuisance_of,
    nuisance_with_prior,
    nuisances,
    slowest_update_s,
    variant_of,
)
from ges.diagnose.design.drives import Drive, have_same_drive
from ges.diagnose.design.feedback import (
    OWN_MOMENT,
    EndogenousParts,
    FlightInstruments,
    endogenous_parts,
    feedback_of,
    flight_instruments,
    merge_endogenous_parts,
    subtract_trims,
)
from ges.diagnose.design.motion import motion_of
from ges.diagnose.design.residual import Evaluation, evaluate, with_higher_orders
from ges.diagnose.design.table import ColumnTable, Indices, table_of
from ges.diagnose.design.weak import (
    Windows,
    blocks_of,
    make_windows,
)
from ges.diagnose.library.candidates import Variant
from ges.diagnose.prepare.align import Prepared
from ges.diagnose.prepare.channels import MOMENT, channels, drive, least_rms_in
from ges.diagnose.settings import settings
from ges.diagnose.types.keys import MarkedChannel, ParameterKey
from ges.diagnose.types.model import Model, block_of
from ges.simulator import effects as effect_table
from ges.threads import each


@dataclasses.dataclass(frozen=True)
class FlightRows:
    """Residuals and columns of one flight.

    Attributes
    ----------
    flight, windows : of the rows; windows on the ground belong to the drive alone.
    y : (m, C) residuals, NaN where a channel is absent.
    x : columns, (m, C, K).
    covariate : (m,) covariate of the variance, see :func:`thrust_change`.
    endogenous : parts of columns that instruments do not explain.
    instruments : of the flight; None where they are off.
    air : (m,) True for windows in the air.
    drive_error : by channel, (m,) model error of unit sd, where more is commanded than in the air.
    drive : rotor speeds of the model; None where they are not known.
    """

    flight: Prepared
    windows: Windows
    y: np.ndarray
    x: ColumnTable
    covariate: np.ndarray
    endogenous: EndogenousParts
    instruments: FlightInstruments | None
    air: np.ndarray
    drive_error: Mapping[int, np.ndarray]
    drive: Drive | None = None

    @property
    def follows(self) -> np.ndarray:
        """(m,) True where a window directly follows the one before."""
        # neighbours stand half a window apart; a longer step is a gap between them
        half = np.diff(self.windows.center)
        return np.r_[False, half == half.min()] if len(half) else np.zeros(len(self.windows), bool)

    def in_air(self, channels: Indices) -> np.ndarray:
        """Return residuals in the air.

        Parameters
        ----------
        channels : indices of c channels.

        Returns
        -------
        (a, c), in the channels' units.
        """
        return self.y[np.ix_(self.air, np.asarray(channels, dtype=int))]

    def mean_columns(self, channels: Sequence[int], wanted: Sequence[int]) -> np.ndarray:
        """Return the means of columns in the air.

        Parameters
        ----------
        channels : indices of c channels.
        wanted : indices of k columns.

        Returns
        -------
        (c, k), in the channels' units over those of the coefficients.
        """
        return np.stack([self.x.of(c, wanted)[self.air].mean(axis=0) for c in channels])

    def weighted_columns(self, terms: Mapping[int, float], count: int) -> np.ndarray:
        """Return a linear combination of columns.

        Parameters
        ----------
        terms : coefficients by column.
        count : the first channels that are summed.

        Returns
        -------
        (m, count), NaN where a channel is absent.
        """
        return np.where(np.isfinite(self.y[:, :count]), self.x.weighted_sum(terms, count), np.nan)


@dataclasses.dataclass(frozen=True)
class System:
    """All flights with the same channels and columns.

    Attributes
    ----------
    model : about which all is linearised.
    names : of the C channels, those of faster test functions last.
    columns : of the design.
    flights : rows by flight.
    length_s : support of the test functions.
    """

    model: Model
    names: tuple[str, ...]
    columns: tuple[DesignColumn, ...]
    flights: tuple[FlightRows, ...]
    length_s: float

    @property
    def recordings(self) -> list[Prepared]:
        """The flights, without their rows."""
        return [r.flight for r in self.flights]

    @property
    def nuisances(self) -> dict[str, int]:
        """Columns of the nuisances by ``effect.parameter``."""
        return {c.key: k for k, c in enumerate(self.columns) if c.nuisance is not None}

    def prior_sd(self, key: str) -> float:
        """Return the prior sd of a nuisance, in the unit of its parameter.

        Parameters
        ----------
        key : ``effect.parameter``, of :attr:`nuisances`.
        """
        return nuisance_of(self.columns[self.nuisances[key]]).sd

    def number_with_prior(self, key: str) -> Nuisance | None:
        """Return a number with its prior: as it is free here, else the usual one, or None.

        Parameters
        ----------
        key : ``effect.parameter``.

        Notes
        -----
        A delay has one, too, where rotor speeds are not logged and none is free.
        """
        if key in self.nuisances:
            return nuisance_of(self.columns[self.nuisances[key]])
        effect, parameter = ParameterKey.of(key)
        usual = effect_table.get(effect).parameter(parameter).prior
        return nuisance_with_prior(key, usual, self.model, self.recordings) if usual else None

    @functools.cached_property
    def reference_scales(self) -> np.ndarray:
        """(c,) what sizes in each main channel are shares of."""
        return np.array([self.model.reference_scale(name) for name in self.main])

    @functools.cached_property
    def least_rms(self) -> np.ndarray:
        """(c,) practical significance threshold of each main channel, rms over all windows."""
        return np.array([least_rms_in(name, self.model) for name in self.main])

    @property
    def main(self) -> tuple[str, ...]:
        """Channels under the plain average, which are reported and drawn."""
        return tuple(name for name in self.names if not MarkedChannel.of(name).mark)

    def with_endogenous_parts_of(self, other: System) -> System:
        """Return the system with the feedback errors of another one of the same columns.

        Parameters
        ----------
        other : system of the same flights. Costs compare under one likelihood only.
        """
        pairs = zip(self.flights, other.flights, strict=True)
        flights = tuple(dataclasses.replace(r, endogenous=o.endogenous) for r, o in pairs)
        return dataclasses.replace(self, flights=flights)

    def blocks(self, length_s: float) -> list[np.ndarray]:
        """Count the blocks of time of every window.

        Parameters
        ----------
        length_s : length of a block.

        Returns
        -------
        By flight, (m,).
        """
        return blocks_of([(r.windows, r.flight.t_s[0]) for r in self.flights], length_s)


def window_length_s(flights: Sequence[Prepared]) -> float:
    """Return the support of the test functions, longer where a stream is slow.

    Parameters
    ----------
    flights : prepared recordings.
    """
    slowest = slowest_update_s(flights, ("velocity", "attitude", "gyro", "rotor_speed", "command"))
    return max(settings.design.window_shortest_s, settings.design.window_updates * slowest)


def channels_of_any(flights: Sequence[Prepared], model: Model) -> tuple[str, ...]:
    """Return the channels that any flight has, those of the flight with most first.

    Parameters
    ----------
    flights : prepared recordings.
    model : of the vehicle.

    Returns
    -------
    Their names.
    """
    listed = [channels(flight, model) for flight in flights]
    return tuple(
        dict.fromkeys(name for names in sorted(listed, key=len, reverse=True) for name in names)
    )


def _channels_of_flight(
    flight: Prepared, windows: Windows, model: Model, names: Sequence[str]
) -> tuple[str, ...]:
    """Return the channels of one flight that are among those of all flights."""
    own = with_higher_orders(channels(flight, model), len(windows.higher_orders))
    return tuple(name for name in own if name in names)


def _in_all_channels(
    names: Sequence[str], here: Sequence[str], evaluated: Evaluation
) -> np.ndarray:
    """Return one flight's channels among those of all flights, (m, C), NaN elsewhere."""
    values = evaluated.stack(here)
    if tuple(names) == tuple(here):
        return values
    full = np.full((len(values), len(names)), np.nan)
    full[:, [names.index(name) for name in here]] = values
    return full


def flight_rows(
    flight: Prepared,
    model: Model,
    names: Sequence[str],
    columns: Sequence[DesignColumn],
    length_s: float,
    computed_columns: Mapping | None = None,
    reuse: FlightRows | None = None,
    drive: Drive | None = None,
) -> FlightRows:
    """Compute residuals and columns of one flight.

    Parameters
    ----------
    flight : prepared recording.
    model : about which the columns are linearised.
    names : of the C channels.
    columns : of the design.
    length_s : support of the test functions.
    computed_columns : columns to reuse, by recipe.
    reuse : rows of the same flight, whose windows, instruments and covariate are reused. These
        hardly change with effects, and costs compare under one likelihood only.
    drive : rotor speeds of the model, where they are known.

    Notes
    -----
    A column is minus the residual's change per unit of its coefficient.
    """
    windows = (
        reuse.windows
        if reuse
        else make_windows(flight.t_s, flight.driven, length_s, half_waves(flight, length_s))
    )
    air = windows.within(flight.flying)
    driven = np.array([block_of(name) == "drive" for name in names])
    here = _channels_of_flight(flight, windows, model, names)
    # parts of one column are made of the same: computed once, and not at all where it is known
    computed, by_recipe = computed_columns or {}, {c.recipe: c for c in columns}
    new = {recipe: c for recipe, c in by_recipe.items() if recipe not in computed}
    drive, drives = fly_drives_of_columns(flight, model, here, list(new.values()), drive)
    base = evaluate(flight, windows, model, here, drive=drive)
    y = _in_all_channels(names, here, base)
    changes = evaluate_columns(
        flight, windows, model, names, here, base, list(new.values()), drives
    )
    values = {**computed, **dict(zip(new, changes, strict=True))}
    x = table_of([c.own_changes(values[c.recipe], names) for c in columns], *y.shape)
    # a beam that tilted a little further would see no ground
    y = np.where(x.finite() & (air[:, None] | driven), y, np.nan)
    thrust = _thrust_N(model, base.drive)
    dynamic = [
        k for k, c in enumerate(columns) if c.recipe in new and feedback_of(c.key) == "dynamic"
    ]
    # what is constant in a moment, or goes with thrust, is a trim; with other trims in every round
    # of a fit no cost would fall along the columns
    trim_thrust = _thrust_N(model, reuse.drive) if reuse and reuse.drive else thrust
    x = subtract_trims(dynamic, x, windows, names, trim_thrust, base.motion.omega, air)
    if reuse or not settings.design.instruments:
        instruments = reuse.instruments if reuse else None
    else:
        instruments = flight_instruments(
            flight, windows.select(air), model, names, y[air], base.drive.acting_speeds
        )
    rows = FlightRows(
        flight,
        windows,
        y,
        x,
        reuse.covariate if reuse else thrust_change(flight, windows, model, thrust),
        {},
        instruments,
        air,
        _drive_form_error(flight, windows, names, base.drive.commanded),
        base.drive,
    )
    return dataclasses.replace(
        rows, endogenous=_parts_of_flight(rows, model, names, columns, reuse)
    )


def _parts_of_flight(
    rows: FlightRows,
    model: Model,
    names: Sequence[str],
    columns: Sequence[DesignColumn],
    reuse: FlightRows | None,
) -> EndogenousParts:
    """Return what instruments do not explain of the columns; of nuisances as it was before."""
    # projected over all windows in the air: a channel that has gaps, or had any, has none
    same_windows = [rows, reuse] if reuse else [rows]
    whole = np.all([np.isfinite(r.y[r.air]).all(axis=0) for r in same_windows], axis=0)
    in_air = {c: name for c, name in enumerate(names) if whole[c]}
    own = [k for k, c in enumerate(columns) if not (reuse and c.nuisance)]
    # of an effect that is on, the moment's part has a coefficient of its own, endogenous by itself
    separate_keys = [
        f"{c.key}{OWN_MOMENT}"
        if (c := columns[k]).part == "moment" and variant_of(c).effect in model.effects
        else c.key
        for k in own
    ]
    flight = rows.flight
    parts: EndogenousParts = (
        endogenous_parts(
            separate_keys,
            table_of(rows.x.columns(own), *rows.y.shape),
            rows.windows.length_s,
            in_air,
            rows.instruments,
            rows.air,
            model.effects,
            rates_measured=flight.has("gyro") or "attitude" not in flight.derived,
        )
        if rows.instruments
        else {}
    )
    if not reuse:
        return parts
    earlier = {at: own for at, own in reuse.endogenous.items() if at[1] in in_air}
    return merge_endogenous_parts(earlier, parts, model.effects)


def residuals_with(system: System, model: Model) -> list[np.ndarray]:
    """Compute the residuals of a system's windows and channels under another model.

    Parameters
    ----------
    system : of the flights.
    model : that is evaluated.

    Returns
    -------
    By flight, (m, C).
    """
    return each(lambda rows: flight_residuals(rows, system.names, model), system.flights)


def flight_residuals(
    rows: FlightRows, names: Sequence[str], model: Model, block: str = ""
) -> np.ndarray:
    """Compute the residuals of one flight's windows under another model.

    Parameters
    ----------
    rows : of the flight.
    names : of the C channels.
    model : that is evaluated.
    block : of channels that are wanted; all where not given.

    Returns
    -------
    (m, C), NaN in channels that are not wanted.
    """
    here = _channels_of_flight(rows.flight, rows.windows, model, names)
    here = tuple(name for name in here if block in ("", block_of(name)))
    if not here:
        return np.full_like(rows.y, np.nan)
    y = _in_all_channels(names, here, evaluate(rows.flight, rows.windows, model, here))
    return np.where(np.isfinite(rows.y), y, np.nan)


def _thrust_N(model: Model, drive: Drive) -> np.ndarray:
    """Return nominal thrust of all rotors, (n,)."""
    return model.number("thrust_coefficient_N_s2") * (drive.acting_speeds**2).sum(axis=1)


def with_trims_of(system: System, other: Model, reuse: System) -> System:
    """Return the system with the trims of moments of another model.

    Parameters
    ----------
    system : of a model with effects whose columns lack their trim.
    other : the model without these effects.
    reuse : system of the same flights whose parts ``system`` reuses; a trim goes with its thrust.

    Notes
    -----
    A residual is without what its columns are without; else no cost falls along them.
    """

    def of_flight(rows: FlightRows, reused_rows: FlightRows) -> FlightRows:
        before = flight_residuals(rows, system.names, other, "moment")
        change = rows.y - before
        whole = np.isfinite(change[rows.air]).all(axis=0)
        moments = [c for c, n in enumerate(system.names) if block_of(n) == "moment" and whole[c]]
        drive, motion = (
            reused_rows.drive,
            motion_of(rows.flight, system.model, system.model.effects),
        )
        if drive is None:
            raise ValueError("the drive of a flight is not known; build the system anew")
        without_trim = subtract_trims(
            [0],
            table_of([{c: change[:, c] for c in moments}], *rows.y.shape),
            rows.windows,
            system.names,
            _thrust_N(system.model, drive),
            motion.omega,
            rows.air,
        )
        y = rows.y.copy()
        for c in moments:
            y[:, c] = before[:, c] + without_trim.of(c, [0])[:, 0]
        return dataclasses.replace(rows, y=y)

    flights = each(of_flight, system.flights, reuse.flights)
    return dataclasses.replace(system, flights=tuple(flights))


def _drive_form_error(
    flight: Prepared, windows: Windows, names: Sequence[str], commanded: np.ndarray | None
) -> dict[int, np.ndarray]:
    """Return model error of the drive on the ground, by channel, (m,).

    Commands (n, rotors) beyond all in the air are multiplied by the form error of their speeds.
    """
    if commanded is None or not (flight.driven & ~flight.flying).any():
        return {}
    excess = settings.estimate.form_error * np.maximum(
        commanded - commanded[flight.flying].max(axis=0), 0.0
    )
    by_name = {
        f"{name}{mark}": mean @ speeds
        for name, speeds in zip(drive(excess.shape[1]), excess.T, strict=True)
        for mark, (mean, _) in windows.functions.items()
    }
    return {
        c: by_name[name] for c, name in enumerate(names) if name in by_name and by_name[name].any()
    }


def half_waves(flight: Prepared, length_s: float) -> int:
    """Return how many half-waves a test function may have before a stream cannot follow it.

    Parameters
    ----------
    flight : prepared recording.
    length_s : support of the test function.
    """
    slowest = slowest_update_s([flight], ("gyro", "attitude", "rotor_speed", "command")) or np.inf
    # a half-wave has to span as many updates of a stream as the shortest window has to
    shortest_s = settings.design.window_updates * slowest
    return min(settings.design.half_waves_most, int(length_s / shortest_s))


def thrust_change(
    flight: Prepared, windows: Windows, model: Model, thrust: np.ndarray
) -> np.ndarray:
    """Return the change of thrust between two readings of the rotor speeds, over weight.

    Parameters
    ----------
    flight : prepared recording.
    windows : m windows of the flight.
    model : of the vehicle.
    thrust : (n,) N.

    Returns
    -------
    (m,), the covariate of the variance: how much a slow stream may hide.
    """
    every = flight.update_s.get(
        "rotor_speed" if flight.has("rotor_speed") else "command", flight.dt_s
    )
    rate = np.abs(np.gradient(thrust, flight.dt_s)) / model.weight_N
    return windows.mean @ rate * (every if np.isfinite(every) else flight.dt_s)


def _computed_columns(system: System, flight: FlightRows, model: Model, wanted: set[tuple]) -> dict:
    """Return columns of one flight to reuse, by recipe.

    They are nuisances at the same corrections, and others if wanted and computed for this very
    model.
    """
    same_corrections = system.model.corrections == model.corrections
    known = {
        k: c.recipe
        for k, c in enumerate(system.columns)
        if (c.nuisance is not None and same_corrections)
        or (system.model is model and c.recipe in wanted)
    }
    computed: dict = {}
    for recipe, column in zip(known.values(), flight.x.columns(list(known)), strict=True):
        computed[recipe] = computed.get(recipe, {}) | column
    return computed


def build(
    flights: Sequence[Prepared],
    model: Model,
    variants: Sequence[Variant],
    reuse: System | None = None,
    length_s: float | None = None,
) -> System:
    """Build the system: nuisance columns first, then every amplitude of every variant.

    Parameters
    ----------
    flights : prepared recordings.
    model : about which the columns are linearised.
    variants : of candidates.
    reuse : a system of the same flights and channels. Windows and instruments are reused, and
        nuisance columns at the same corrections, which hardly change with effects; all columns
        where the model is the same.
    length_s : support of the test functions; of :func:`window_length_s` where not given.
    """
    main = channels_of_any(flights, model)
    length_s = reuse.length_s if reuse else length_s or window_length_s(flights)
    # a sine and a cosine of every half-wave
    names = with_higher_orders(main, 2 * max(half_waves(f, length_s) for f in flights))
    columns = (
        [DesignColumn(n.key, nuisance=n) for n in nuisances(model, main, flights)]
        if settings.design.nominal_tolerance
        else []
    )
    for v in variants:
        # without channels of moments there is nothing to split
        parts = column_parts(v, {w.effect for w in variants}) if MOMENT[0] in names else ("",)
        columns += [
            DesignColumn(v.key, variant=v, amplitude=j, part=part)
            for j in range(len(v.amplitudes))
            for part in parts
        ]
    return _build_columns(flights, model, names, columns, reuse, length_s)


def with_columns(system: System, columns: Sequence[DesignColumn]) -> System:
    """Return the system with these columns in place of its own.

    Parameters
    ----------
    system : of the flights.
    columns : of the same vehicle.
    """
    return _build_columns(
        system.recordings, system.model, system.names, columns, system, system.length_s
    )


def _build_columns(
    flights: Sequence[Prepared],
    model: Model,
    names: tuple[str, ...],
    columns: Sequence[DesignColumn],
    reuse: System | None,
    length_s: float,
) -> System:
    """Build the system of these channels and columns."""
    reused: Sequence[FlightRows | None] = reuse.flights if reuse else [None] * len(flights)
    wanted = {c.recipe for c in columns}
    computed_columns = [
        _computed_columns(reuse, r, model, wanted) if reuse and r else {} for r in reused
    ]
    same_drive = reuse is not None and have_same_drive(reuse.model, model)
    # another path leaves the columns of a flight, and what its commands do, as they were
    drives = [
        r.drive if r and same_drive and r.flight.columns is f.columns else None
        for f, r in zip(flights, reused, strict=True)
    ]
    of_flights = each(
        lambda f, k, r, d: flight_rows(f, model, names, columns, length_s, k, r, d),
        flights,
        computed_columns,
        reused,
        drives,
    )
    return System(model, names, tuple(columns), tuple(of_flights), length_s)
