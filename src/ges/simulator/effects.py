"""The physical effects, read from the compiled simulator, and their forces along recorded flights.

There is no second copy of any physics in Python. :func:`table` lists what the library holds,
:func:`replay` calls the compiled functions, and :func:`evaluate` gives what one effect adds.
"""

from __future__ import annotations

import dataclasses
import fnmatch
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ges.conventions import MAX_ROTORS, rotor_columns, rotors_in
from ges.errors import GesError, UsageError, unknown_name
from ges.simulator import _lib, laws
from ges.simulator.parameters import parameter_vector, rotors_of
from ges.simulator.terrain import Terrain

if TYPE_CHECKING:
    import pandas as pd

MOST_LANES = 8
"""Sets of effects or flights that the widest processors take together."""

Effects = Mapping[str, Mapping[str, float]]


@dataclasses.dataclass(frozen=True)
class ParameterPrior:
    """How far a parameter may be off without being a finding.

    Numbers are in the parameter's unit, or in arm lengths.

    Attributes
    ----------
    shows_in : channels or blocks of them, of which one must be present; ``("any",)`` for all.
    step : distance from neutral at which it is linearised.
    sd : usual standard deviation.
    flight_sd : standard deviation between flights of one vehicle.
    mean : usual value.
    per_arm : whether step and sds are in arm lengths.
    reciprocal : whether it acts as 1/(1 + x), which is linear within the sds.
    timing : ``delay`` or ``lag`` of the drive, to which the recording adds uncertainty; '' for
        neither.
    with_voltage : whether it is free where every flight logged the battery's voltage.
    unlogged_voltage_sd : standard deviation between flights without voltage; where rotor speeds
        were logged, of a drive alone.
    """

    shows_in: tuple[str, ...]
    step: float
    sd: float
    flight_sd: float
    mean: float
    per_arm: bool
    reciprocal: bool
    timing: str
    with_voltage: bool
    unlogged_voltage_sd: float


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, as ``ges_effect_parameter`` of ``sim_c/effects/descriptor.h``.

    Attributes
    ----------
    name : name of the parameter.
    unit : ``1`` where it has none.
    doc : its meaning, in words.
    role : ``amplitude``, ``shape`` or ``switch``.
    default : typical size, used when an effect is switched on by name alone.
    neutral : value at which the effect vanishes, or of a vehicle that states none; NaN for neither.
    low, high : bounds.
    fit_low, fit_high : bounds of a fit.
    plausible : plausible standard deviation; 0 where nothing is known.
    usual, usual_sd : usual value of a shape, and its standard deviation; sd 0 where none is usual.
    usual_share : share of the weight at 1 m/s, where another effect needs this one to act through.
    fitted : whether flights may move this shape.
    whole : whether it is one axis of a vector that is fitted whole.
    rotor : number of its rotor, from 1; 0 for none.
    trim : kind of trim: ``thrust``, ``rotor``, ``lever``, ``yaw``; '' for none.
    corrects : nominal parameters of the vehicle file that it corrects.
    acts_above : another parameter, and the value above which this one acts; None for always.
    reach, reach_over : largest step of a fit, as a share of ``radius``, ``hull`` or of a parameter;
        0 for any. A place on the body never leaves its hull.
    prior : how far it may be off without being a finding; None if by nothing.
    """

    name: str
    unit: str
    doc: str
    role: str
    default: float
    neutral: float
    low: float
    high: float
    fit_low: float
    fit_high: float
    plausible: float
    usual: float
    usual_sd: float
    usual_share: float
    fitted: bool
    whole: bool
    rotor: int
    trim: str
    corrects: tuple[str, ...]
    acts_above: tuple[str, float] | None
    reach: float
    reach_over: str
    prior: ParameterPrior | None


@dataclasses.dataclass(frozen=True)
class SearchHints:
    """Variants of an effect that a search tries, ``ges_search`` of ``sim_c/effects/descriptor.h``.

    Attributes
    ----------
    amplitudes : parameters that are fitted together.
    rule : function of :mod:`ges.diagnose.library.grids` that lays out the variants; '' for one a
        level.
    fixed : parameters and the values at which they are held.
    axis : shapes that vary over the levels.
    across : one more shape, varied within the sd that the vehicle file has of it; '' for none.
    levels : values of the axis.
    modified : whether it is tried with each effect that modifies it.
    """

    amplitudes: tuple[str, ...]
    rule: str
    fixed: Mapping[str, float]
    axis: tuple[str, ...]
    across: str
    levels: tuple[float, ...]
    modified: bool


@dataclasses.dataclass(frozen=True)
class Effect:
    """Descriptor of one compiled effect, as ``sim_c/effects/descriptor.h`` lays it out.

    Attributes
    ----------
    number : index in the compiled library; -1 for laws.
    name, title : identifier, and a line for people.
    equation, latex : formula, as plain text and as LaTeX, whose lines are parted by ``\\\\``.
    reference : its source.
    modifies : effect that this one modifies; None for an effect of its own.
    channels : channels in which it acts.
    kind : ``wrench``, ``actuator``, ``sensor``, ``wind`` or ``parameter``.
    n_states : number of states that it adds to the vehicle's.
    invariants : any of ``mirror``, ``dissipates``, ``no_work``, ``fades``, ``free_air``.
    parameters : all, in the library's order.
    about : what a finding is about: ``physics``, ``parameter`` or ``sensor``.
    feedback : how the controller's response shows in it: ``none``, ``dynamic``, ``thrust_gain``,
        ``rotor``, ``load`` or ``height``.
    hints : any of ``GES_HINTS`` of the descriptor, as ``own_lever``.
    rarity : how often it is met, relative to other effects.
    needs : streams that must be recorded.
    requires_one_of : prerequisite effects, of which one must be on for this one to act.
    family : effects of one family act in the same place; its own name if it has none.
    settled : why it enters no search; '' where it does.
    carried : levels at which it is tried together with what it modifies.
    searches : its variants; empty for all amplitudes together.
    """

    number: int
    name: str
    title: str
    equation: str
    latex: str
    reference: str
    modifies: str | None
    channels: tuple[str, ...]
    kind: str
    n_states: int
    invariants: frozenset[str]
    parameters: tuple[Parameter, ...]
    about: str
    feedback: str
    hints: frozenset[str]
    rarity: float
    needs: tuple[str, ...]
    requires_one_of: tuple[str, ...]
    family: str
    settled: str
    carried: tuple[float, ...]
    searches: tuple[SearchHints, ...]

    @property
    def remembers_the_path(self) -> bool:
        """Whether its force depends on earlier states of the flight, not on the present alone."""
        return self.n_states > 0 and self.kind == "wrench"

    def parameter(self, name: str) -> Parameter:
        """Find a parameter.

        Parameters
        ----------
        name : name of the parameter.

        Raises
        ------
        StopIteration
            When the effect has no such parameter.
        """
        return next(p for p in self.parameters if p.name == name)

    @property
    def reads_voltage(self) -> bool:
        """Whether it counts from a battery voltage, which its parameters or the flights state."""
        return "reads_voltage" in self.hints

    @property
    def moves_air(self) -> bool:
        """Whether it is a wind, which acts on what reads the velocity relative to the air."""
        return self.kind == "wind"

    @property
    def latex_lines(self) -> list[str]:
        """The formula in LaTeX, by lines."""
        return self.latex.split(r" \\ ")

    @property
    def prerequisites(self) -> tuple[str, ...]:
        """Effects of which one must be on for this one to act; none for most."""
        return (self.modifies,) if self.modifies else self.requires_one_of

    @property
    def amplitudes(self) -> tuple[str, ...]:
        """Names of the parameters that scale it."""
        return tuple(p.name for p in self.parameters if p.role == "amplitude")

    def of_rotors(self, n_rotors: int) -> tuple[Parameter, ...]:
        """Select the parameters that a vehicle with fewer than 16 rotors has.

        Parameters
        ----------
        n_rotors : number of rotors.

        Returns
        -------
        Parameters of no rotor, and those of rotors 1 to ``n_rotors``.
        """
        return tuple(p for p in self.parameters if p.rotor <= n_rotors)

    @property
    def shapes(self) -> tuple[str, ...]:
        """Names of the shapes that flights may move."""
        return tuple(p.name for p in self.parameters if p.fitted)

    @property
    def lever(self) -> Parameter | None:
        """The shape that scales its moment alone."""
        return next((p for p in self.parameters if p.role == "lever"), None)

    def neutral(self) -> dict[str, float]:
        """Give the parameters at which the effect vanishes.

        Returns
        -------
        Values by name; the default of a parameter that has no neutral value of its own.
        """
        return {p.name: p.default if math.isnan(p.neutral) else p.neutral for p in self.parameters}

    def completed(self, given: Mapping[str, float]) -> dict[str, float]:
        """Complete the parameters of the effect.

        Parameters
        ----------
        given : values by name.

        Returns
        -------
        All parameters in the library's order, with defaults for those not given. If some rotors are
        given, the others are neutral.

        Raises
        ------
        UsageError
            When a name is unknown.
        """
        known = {p.name: p for p in self.parameters}
        for name in given:
            if name not in known:
                raise unknown_name(f"parameter of effect {self.name}", name, known)
        some = any(known[name].rotor for name in given)
        return {
            name: float(given.get(name, p.neutral if some and p.rotor else p.default))
            for name, p in known.items()
        }

    def values(self, given: Mapping[str, float]) -> list[float]:
        """Give the values of :meth:`completed` parameters, in the library's order.

        Parameters
        ----------
        given : values by name; defaults elsewhere.
        """
        return list(self.completed(given).values())


def _require(given: Mapping[str, Any], fields: Sequence[str], of: str) -> None:
    for field in fields:
        if not given[field]:
            raise GesError(
                f"{of} declares no '{field}'; docs/adding-an-effect.md has what an effect says of"
                " itself"
            )


def _parameter(given: dict[str, Any], effect: str) -> Parameter:
    _require(given, ["role"], f"parameter {given['name']} of effect {effect}")
    changed = {
        "default": given["value"],
        "prior": given["prior"] and ParameterPrior(**given["prior"]),
    }
    # C leaves what a descriptor does not say at 0: then a fit has the parameter's own bounds
    if given["fit_low"] == given["fit_high"] == 0.0:
        changed |= {"fit_low": given["low"], "fit_high": given["high"]}
    return Parameter(**{k: v for k, v in (given | changed).items() if k != "value"})


def _search(given: dict[str, Any], parameters: Sequence[Parameter]) -> SearchHints:
    names, words = [p.name for p in parameters], given["amplitudes"]
    amplitudes = tuple(n for word in words for n in fnmatch.filter(names, word))
    return SearchHints(**given | {"amplitudes": amplitudes, "fixed": dict(given["fixed"])})


def _effect(number: int, given: dict[str, Any]) -> Effect:
    """Convert a descriptor; one that leaves out what every effect has to say is an error."""
    name = given["name"]
    _require(given, ["kind", "about", "feedback"], f"effect {name}")
    parameters = tuple(_parameter(p, name) for p in given["parameters"])
    changed = {
        "number": number,
        "modifies": given["modifies"] or None,
        "invariants": frozenset(given["invariants"]),
        "parameters": parameters,
        "hints": frozenset(given["hints"]),
        # not said in C is 0, and an effect is then as rare as any
        "rarity": given["rarity"] or 1.0,
        "family": given["family"] or name,
        "searches": tuple(_search(s, parameters) for s in given["search"]),
    }
    fields = given | changed
    return Effect(**{f.name: fields[f.name] for f in dataclasses.fields(Effect)})


@functools.lru_cache(maxsize=1)
def table() -> dict[str, Effect]:
    """List every compiled effect.

    Returns
    -------
    Effects by name, in the library's order.

    Examples
    --------
    >>> table()["rotor_drag"].parameter("k_kg").unit
    'kg'
    """
    return {
        effect.name: effect for effect in map(_effect, itertools.count(), _lib.effect_descriptors())
    }


class _LawEffect(Effect):
    """Laws as an effect: parameters are coefficients by term (:mod:`ges.simulator.laws`)."""

    def parameter(self, name: str) -> Parameter:
        """Give the coefficient of a term as a parameter; an impossible term is a UsageError."""
        return Parameter(
            name=laws.term_of(name).key,
            unit="1",
            doc="coefficient of the term",
            role="amplitude",
            default=1.0,
            neutral=0.0,
            low=-math.inf,
            high=math.inf,
            fit_low=-math.inf,
            fit_high=math.inf,
            plausible=0.0,
            usual=0.0,
            usual_sd=0.0,
            usual_share=0.0,
            fitted=False,
            whole=False,
            rotor=0,
            trim="",
            corrects=(),
            acts_above=None,
            reach=0.0,
            reach_over="",
            prior=None,
        )


@functools.lru_cache(maxsize=1)
def _law() -> Effect:
    return _LawEffect(
        number=-1,
        name=laws.LAW,
        title="law found in flights, which no effect of the library has",
        equation="F_c = sum_j c_j m g prod_k g_k^n |g_k|^m near_j",
        latex=r"F_c = \sum_j c_j\, m g \prod_k g_k^n |g_k|^m\, \text{near}_j",
        reference="Buckingham 1914",
        modifies=None,
        channels=laws.CHANNELS,
        kind="wrench",
        n_states=0,
        invariants=frozenset(),
        parameters=(),
        about="law",
        feedback="none",
        hints=frozenset(),
        rarity=1.0,
        needs=(),
        requires_one_of=(),
        family=laws.LAW,
        settled="",
        carried=(),
        searches=(),
    )


def only(effects: Effects, keep: Callable[[Effect], object]) -> dict[str, Mapping[str, float]]:
    """Return the effects whose descriptor has a property.

    Parameters
    ----------
    effects : values of parameters, by effect.
    keep : tells of a descriptor whether it has it.
    """
    return {name: values for name, values in effects.items() if keep(get(name))}


def get(name: str) -> Effect:
    """Look up an effect.

    Parameters
    ----------
    name : name of the effect, or :data:`ges.simulator.laws.LAW` for laws as one effect.

    Raises
    ------
    UsageError
        When there is none; the message has the nearest name.
    """
    if name == laws.LAW:
        return _law()
    known = table()
    if name not in known:
        raise unknown_name("effect", name, known)
    return known[name]


def pack(effects: Effects) -> _lib.CEffects:
    """Convert effects to the struct of the compiled library.

    Parameters
    ----------
    effects : parameters by effect; defaults elsewhere.

    Raises
    ------
    UsageError
        When a name is unknown.
    GesError
        When there are more effects or terms of laws than the library takes.
    """
    return _lib.pack_effects(
        [
            (get(name).number, get(name).values(values or {}))
            for name, values in effects.items()
            if name != laws.LAW
        ],
        laws.packed(effects.get(laws.LAW, {})),
    )


def _rows(table: Sequence[_lib.Column], n_rotors: int) -> dict[str, int]:
    """Give the row of each quantity, those of rotors last."""
    fixed = [name for name, _, _, rotor in table if not rotor]
    of_rotors = [
        name.replace("#", str(i + 1)) for name, *_, rotor in table if rotor for i in range(n_rotors)
    ]
    return {name: row for row, name in enumerate((*fixed, *of_rotors))}


@functools.lru_cache(maxsize=MAX_ROTORS)
def sample_rows(n_rotors: int) -> dict[str, int]:
    """Give the row of each quantity that a replay reads.

    Parameters
    ----------
    n_rotors : number of rotors of the vehicle.

    Returns
    -------
    Row of :attr:`Samples.data` by quantity.
    """
    return _rows(_lib.replay_tables()[0], n_rotors)


@functools.lru_cache(maxsize=MAX_ROTORS)
def replay_rows(n_rotors: int) -> dict[str, int]:
    """Give the row of each quantity that a replay gives.

    Parameters
    ----------
    n_rotors : number of rotors of the vehicle.

    Returns
    -------
    Row of :attr:`Replay.data` by quantity.
    """
    return _rows(_lib.replay_tables()[1], n_rotors)


@dataclasses.dataclass(frozen=True)
class Samples:
    """Recorded samples as the compiled library reads them.

    Attributes
    ----------
    data : (k, n) SI, world ENU, body FLU; a row for each quantity of :func:`sample_rows`.
    n_rotors : number of rotors.
    """

    data: np.ndarray
    n_rotors: int

    @property
    def rows(self) -> dict[str, int]:
        """Row of :attr:`data` by quantity."""
        return sample_rows(self.n_rotors)

    @classmethod
    def from_columns(cls, values: Mapping[str, np.ndarray], n_rotors: int | None = None) -> Samples:
        """Make samples from columns of a recording.

        Absent quantities are 0, the attitude level, the battery's voltage NaN. Other names are
        ignored.

        Parameters
        ----------
        values : arrays (n,) by column name; ``t_s`` is required.
        n_rotors : number of rotors; by default as many as have speeds or commands, or four.

        Raises
        ------
        UsageError
            When ``t_s`` is missing.
        """
        if "t_s" not in values:
            raise UsageError("samples need a column t_s")
        n_rotors = n_rotors or rotors_in(values) or 4
        rows = sample_rows(n_rotors)
        data = np.zeros((len(rows), len(values["t_s"])))
        # level attitude; a battery of 0 V would be a reading, NaN is none
        data[rows["q_w"]] = 1.0
        data[rows["battery_V"]] = np.nan
        for name, row in rows.items():
            if name in values:
                data[row] = values[name]
        return cls(data, n_rotors)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame) -> Samples:
        """Make samples from the table of a recording, as :meth:`from_columns` does.

        Parameters
        ----------
        frame : table (n rows) with ``t_s`` and contract columns.
        """
        return cls.from_columns(
            {
                name: frame[name].to_numpy(dtype=float)
                for name in frame.columns
                if name in sample_rows(rotors_in(frame.columns) or 4)
            }
        )

    def of(self, n_rotors: int) -> Samples:
        """Convert to another number of rotors.

        Parameters
        ----------
        n_rotors : number of rotors.

        Returns
        -------
        Samples in which added rotors stand still.
        """
        if n_rotors == self.n_rotors:
            return self
        return Samples.from_columns(
            {name: self.data[row] for name, row in self.rows.items()}, n_rotors
        )

    def __len__(self) -> int:
        return self.data.shape[1]


FORCE_N = ("force_x_N", "force_y_N", "force_z_N")
MOMENT_NM = ("moment_x_Nm", "moment_y_Nm", "moment_z_Nm")


@dataclasses.dataclass(frozen=True)
class Replay:
    """The model along n recorded samples.

    An item, as ``replay["force_z_N"]``, is a column (n,) by name, body frame, SI.

    Attributes
    ----------
    data : (k, n), a row for each quantity.
    n_rotors : number of rotors.
    names : of the k quantities, of :func:`replay_rows`.
    """

    data: np.ndarray
    n_rotors: int
    names: tuple[str, ...]

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.names:
            raise unknown_name("replay column", name, self.names)
        return self.data[self.names.index(name)]

    def stack(self, *names: str) -> np.ndarray:
        """Give several columns as an array (n, k).

        Parameters
        ----------
        *names : quantities of :func:`replay_rows`.

        Raises
        ------
        UsageError
            When a name is unknown.
        """
        return np.stack([self[name] for name in names], axis=1)

    @property
    def force_N(self) -> np.ndarray:
        """Force on the body without gravity, body frame, (n, 3)."""
        return self.stack(*FORCE_N)

    @property
    def moment_Nm(self) -> np.ndarray:
        """Moment on the body without the gyroscopic term, body frame, (n, 3)."""
        return self.stack(*MOMENT_NM)

    @property
    def thrust_N(self) -> np.ndarray:
        """Thrust of each rotor, (n, n_rotors)."""
        return self.stack(*rotor_columns("thrust_{}_N", self.n_rotors))

    @property
    def rotor_command_rad_s(self) -> np.ndarray:
        """Commanded rotor speeds before the motor lag, (n, n_rotors)."""
        return self.stack(*rotor_columns("rotor_command_{}_rad_s", self.n_rotors))


def replay(
    parameters: Mapping[str, float],
    samples: Samples,
    effects: Effects | None = None,
    terrain: Terrain | None = None,
    lanes: int = 0,
    wanted: Iterable[str] | None = None,
) -> Replay:
    """Compute forces, drive and sensor readings of the model along recorded samples.

    Parameters
    ----------
    parameters : numbers of the vehicle by name of
        :func:`ges.simulator.parameters.parameters`; defaults elsewhere.
    samples : n recorded samples; in order of time if an effect has states of its own.
    effects : effects that are switched on; none by default.
    terrain : ground; flat at 0 by default.
    lanes : samples that are computed together; 0 for what suits the processor. Results are the same
        bits.
    wanted : names of :func:`replay_rows` to give; by default all.

    Returns
    -------
    Columns (n,) of the model, body frame, SI.

    Raises
    ------
    GesError
        When a number is out of its bounds.
    UsageError
        When a name is unknown.
    """
    return replay_each(parameters, samples, [effects or {}], terrain, lanes, wanted)[0]


def replay_each(
    parameters: Mapping[str, float],
    samples: Samples,
    sets: Sequence[Effects],
    terrain: Terrain | None = None,
    lanes: int = 0,
    wanted: Iterable[str] | None = None,
) -> list[Replay]:
    """Compute :func:`replay` under each of several sets of effects.

    Sets with states of their own are computed side by side where they have the same effects.

    Parameters
    ----------
    parameters, samples, terrain, lanes, wanted : as of :func:`replay`.
    sets : sets of effects, each with parameters by effect.

    Returns
    -------
    One replay for each set, in their order.
    """
    terrain = terrain or Terrain.flat()
    vector = parameter_vector({**terrain.parameters(), **parameters})
    heights, packed = terrain.height_map(), [pack(e) for e in sets]
    grid = None if heights is None else _lib.pack_grid(*heights)
    n_rotors = rotors_of(parameters)
    prepared, rows = samples.of(n_rotors), replay_rows(n_rotors)
    names = tuple(rows if wanted is None else wanted)
    for name in names:
        if name not in rows:
            raise unknown_name("replay column", name, rows)
    columns = [rows[name] for name in names]
    replayed = _lib.replay(vector, packed, grid, prepared.data, columns, lanes)
    return [Replay(data, n_rotors, names) for data in replayed]


def evaluate(
    name: str,
    values: Mapping[str, float],
    samples: Samples,
    parameters: Mapping[str, float],
    effects: Effects | None = None,
    terrain: Terrain | None = None,
) -> Replay:
    """Compute what one effect adds to the model along recorded samples.

    Parameters
    ----------
    name : the effect.
    values : its parameters by name; defaults elsewhere.
    samples, parameters, terrain : as of :func:`replay`.
    effects : effects that are already on; an effect that modifies another needs that one here.

    Returns
    -------
    Differences (n,): the model with the effect less the model without it.

    Raises
    ------
    UsageError
        When the effect is already on, or a name is unknown.
    """
    base = dict(effects or {})
    if name in base:
        raise UsageError(
            f"effect {name} is already switched on; change its parameters instead of adding it"
            " again"
        )
    # evaluated beside what is on, since a modifier alone adds nothing
    with_it = replay(parameters, samples, {**base, name: values}, terrain)
    without = replay(parameters, samples, base, terrain)
    return dataclasses.replace(without, data=with_it.data - without.data)


def evaluate_terms(
    terms: Sequence[laws.Term],
    parameters: Mapping[str, float],
    samples: Samples,
    effects: Effects,
    terrain: Terrain,
) -> np.ndarray:
    """Compute what terms with a coefficient of one add along n recorded samples.

    Parameters
    ----------
    terms : the terms.
    parameters, samples, effects, terrain : as of :func:`replay_each`.

    Returns
    -------
    Array (n, terms) in N or N m, body frame, as the compiled simulator has it.
    """
    return np.stack(list(each_term(terms, parameters, samples, effects, terrain)), axis=1)


def each_term(
    terms: Sequence[laws.Term],
    parameters: Mapping[str, float],
    samples: Samples,
    effects: Effects,
    terrain: Terrain,
) -> Iterator[np.ndarray]:
    """Compute what :func:`evaluate_terms` does, one term after another.

    Parameters
    ----------
    terms, parameters, samples, effects, terrain : as of :func:`evaluate_terms`.

    Yields
    ------
    Array (n,) of each term.
    """
    rows = samples.rows
    p_m = samples.data[[rows["p_x_m"], rows["p_y_m"]]].T
    used = [
        g for k, g in enumerate(laws.groups()) if any(t.power[k] + t.magnitude[k] for t in terms)
    ]
    # one replay tells a share of the weight in every channel: what each adds is weight times group
    probes = [
        laws.Term.of(laws.CHANNELS[i % 6], laws.SCALES[0], {g: 1}) for i, g in enumerate(used)
    ]
    batches = [probes[i : i + 6] for i in range(0, len(probes), 6)]
    scales = [[laws.Term.of(c, scale, {}) for c in laws.CHANNELS] for scale in laws.SCALES]
    sets = [{**effects, laws.LAW: {t.key: 1.0 for t in batch}} for batch in ([], *scales, *batches)]
    without, *each = [
        np.hstack([r.force_N, r.moment_Nm])
        for r in replay_each(parameters, samples, sets, terrain, wanted=(*FORCE_N, *MOMENT_NM))
    ]
    scale = {name: r - without for name, r in zip(laws.SCALES, each, strict=False)}
    group = {
        g: ((each[len(laws.SCALES) + i // 6] - without) / scale[laws.SCALES[0]])[:, i % 6]
        for i, g in enumerate(used)
    }
    for t in terms:
        yield scale[t.scale][:, laws.CHANNELS.index(t.channel)] * t.product(group, p_m)
