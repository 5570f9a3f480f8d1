"""Every number of the method: its unit, its meaning and its source.

``settings`` is read where a number is needed (``settings.evidence.tempering``). :func:`using` sets
numbers for a while, as ``ges diagnose --set evidence.tempering=0.5`` does. Numbers of effects
(priors, grids, bounds) stand in their descriptors, constants of nature in :mod:`ges.conventions`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from typing import Any, cast, get_type_hints

import pydantic
from scipy.special import fdtri

from ges.conventions import QUANTILES_95
from ges.errors import UsageError, unknown_name


@dataclasses.dataclass(frozen=True)
class Measured:
    """A number that was set by what it does to recordings or concealed cases.

    Attributes
    ----------
    what : what was seen.
    seeds : of the concealed cases; in words where the history names none.
    commit : that set the number.
    command : that shows it again.
    """

    what: str
    seeds: str
    commit: str
    command: str

    def __str__(self) -> str:
        return f"measured: {self.what} ({self.seeds}; commit {self.commit}; `{self.command}`)"


@dataclasses.dataclass(frozen=True)
class Convention:
    """A number that was agreed on, because one is needed.

    Attributes
    ----------
    why : reason for the choice.
    """

    why: str

    def __str__(self) -> str:
        return f"{type(self).__name__.lower()}: {self.why}"


class Numerical(Convention):
    """A convention that no result should depend on."""


Source = Measured | Convention


ABOVE_ZERO, BELOW_ONE = math.nextafter(0.0, 1.0), math.nextafter(1.0, 0.0)


@dataclasses.dataclass(frozen=True)
class About:
    """Description of a number.

    Attributes
    ----------
    unit : '' where it has none.
    meaning : in words.
    source : where it comes from.
    low, high : least and greatest value that is allowed.
    """

    unit: str
    meaning: str
    source: Source
    low: float
    high: float

    @property
    def allowed(self) -> str:
        """The allowed values in words."""
        low = "above 0" if self.low == ABOVE_ZERO else f"{self.low:g}"
        if self.high == BELOW_ONE:
            return f"{low} to below 1"
        more = low if self.low == ABOVE_ZERO else f"{low} or more"
        return f"{low} to {self.high:g}" if math.isfinite(self.high) else more


def setting(
    value: Any,
    meaning: str,
    source: Source,
    unit: str = "",
    low: float = ABOVE_ZERO,
    high: float = math.inf,
) -> Any:
    """Return a field of a stage.

    Parameters
    ----------
    value : default; of several numbers each lies within the bounds.
    meaning, source, unit, low, high : as in :class:`About`.
    """
    return dataclasses.field(
        default=value, metadata={"about": About(unit, meaning, source, low, high)}
    )


def probability(value: float, meaning: str, source: Source) -> Any:
    """Return a field that is a probability.

    Parameters
    ----------
    value : default, between 0 and 1.
    meaning, source : as in :class:`About`.
    """
    return setting(value, meaning, source, high=BELOW_ONE)


RUN = "ges blind run DIR --set KEY=VALUE && ges blind score DIR --set KEY=VALUE"


@dataclasses.dataclass(frozen=True)
class StatisticsSettings:
    """Levels of certainty that all stages share."""

    acceptance_probability: float = probability(
        0.9,
        "A name is accepted, an explanation ruled in, from this posterior probability on; what is"
        " left of one is from where something is possible.",
        Convention("nine in ten; alarms on nulls are scored against it, not set by it"),
    )
    certain_probability: float = probability(
        0.999,
        "What is as good as certain; what is left of one is negligible.",
        Convention("a thousand to one; not measured against other odds"),
    )
    chance: float = probability(
        0.01,
        "Chance at which flights without any fault show a structure, gusts, or a shifted balance.",
        Convention("one in a hundred for each of three tests; not measured against other levels"),
    )
    clear_sds: float = setting(
        3.0,
        "Deviation of a fitted effect, a term, a delay, a held reading or a calibrated number that"
        " counts.",
        Convention("one in 370 of Gaussian errors"),
        unit="sds",
    )
    certain_sds: float = setting(
        4.0,
        "Deviation from which a delay, an offset or a nominal parameter is no chance.",
        Convention(
            "one in 16,000 of honest prior sds, so that one of ten numbers is called in fewer than"
            " one of a thousand vehicles"
        ),
        unit="sds",
    )
    least_gain: float = setting(
        0.02,
        "Share of an error or of a variance from which a change, or a large structure, counts.",
        Convention("two in a hundred, a small part of what flights of a day differ by"),
    )
    extreme_quantile: float = setting(
        0.01,
        "Quantile that stands for the least of a signal, its complement for the most.",
        Convention("no single sample"),
        high=0.5,
    )
    ridge_windows: float = setting(
        3.0,
        "Windows that a prior of no relation is worth.",
        Numerical("few against a flight's hundreds"),
        unit="windows",
    )
    block_s: float = setting(
        5.0,
        "Length of blocks of time that count as independent, and of means in which gusts show.",
        Convention("longer than a gust or a correction of a controller lasts; not measured"),
        unit="s",
    )
    folds: int = setting(
        4,
        "Parts of the time of which each is predicted from the others.",
        Convention("few enough for short flights; not measured"),
        low=2,
    )
    resamples: int = setting(
        499,
        "Draws behind an interval or a chance.",
        Numerical("a chance of a hundredth is good to a half"),
        low=99,
    )
    seed: int = setting(
        0, "Seed of every draw.", Numerical("results are the same every time"), low=0
    )

    @property
    def acceptance_log_odds(self) -> float:
        """Log odds of the acceptance probability."""
        return math.log(self.acceptance_probability / (1.0 - self.acceptance_probability))

    @property
    def certain_log_odds(self) -> float:
        """Log odds of what is as good as certain."""
        return math.log(self.certain_probability / (1.0 - self.certain_probability))

    @property
    def flights_ratio(self) -> float:
        """Rms of one flight over that of others which chance exceeds in one of twenty.

        Each is known from as many independent parts as there are folds.
        """
        free = self.folds - 1
        return math.sqrt(float(fdtri(free, free, 1.0 - 2.0 * QUANTILES_95[0])))

    @property
    def possible_probability(self) -> float:
        """Probability above which a rival of an accepted name is still possible."""
        return 1.0 - self.acceptance_probability


@dataclasses.dataclass(frozen=True)
class NumericsSettings:
    """Limits of arithmetic and of iterations."""

    tiny: float = setting(1e-30, "What a divisor or a logarithm is at least.", Numerical("no zero"))
    small: float = setting(
        1e-9, "Relative difference that is rounding.", Numerical("far above 64 bit's")
    )
    wide_factor: float = setting(
        10.0,
        "How much wider than its prior a coefficient may be where the flights alone shall set it.",
        Numerical("a prior so wide weighs a hundredth"),
    )
    step_s: float = setting(
        0.0025,
        "Longest step of a replayed drive, of a flight along references and of a rollout.",
        Numerical("a sixth of a fast motor's lag"),
        unit="s",
    )
    noise_rounds: int = setting(
        4,
        "Most rounds of search and noise, or of noise and nuisances.",
        Numerical("most sets need two; not measured"),
        low=1,
    )
    fit_rounds: int = setting(
        12, "Most Gauss-Newton rounds of a fit.", Numerical("most fits need four"), low=1
    )
    shortening_most: float = setting(
        0.1,
        "Least share of a step of a fit that is tried after it cost more than it saved.",
        Numerical("the safeguard of interpolation, Nocedal and Wright 2006, section 3.5"),
        high=1.0,
    )
    cached_numbers: int = setting(
        32768,
        "Numbers of a channel that are whitened together.",
        Numerical("a quarter of a megabyte, which a core's cache has"),
        low=1,
    )
    bound_sweeps: int = setting(
        3,
        "Sweeps of expectation propagation over bounded coefficients.",
        Measured(
            "of 1600 tied sets of two to seven coefficients none is farther than 0.04 nats from"
            " where more sweeps lead",
            "seed 1022",
            "a1652d9",
            "pytest tests/diagnose/test_within.py",
        ),
        low=1,
    )
    gain_ratio_least: float = setting(
        0.75,
        "Actual over predicted fall of the cost from which a step is as good as predicted.",
        Numerical("Nocedal and Wright 2006, Numerical Optimization, algorithm 4.1"),
        high=1.0,
    )
    sets_at_once: int = setting(
        4096, "Sets of candidates that are weighed as one array.", Numerical("memory"), low=1
    )


@dataclasses.dataclass(frozen=True)
class PrepareSettings:
    """Grid, samples in the air, delays between streams, noisy readings."""

    grid_step_shortest_s: float = setting(
        0.005,
        "Finest grid.",
        Convention("faster logs repeat the vibration of the rotors"),
        unit="s",
    )
    flight_shortest_s: float = setting(
        3.0,
        "Shortest recording, time in the air, and time that tells a delay.",
        Convention("fifteen of the shortest windows; not measured"),
        unit="s",
    )
    lifting_share: float = setting(
        0.7,
        "Share of the usual thrust that carries the vehicle; well above the ground the rest of it,"
        " as in a brisk descent, is still flight.",
        Convention(
            "below it no height is held; brisk descents of real flights were taken for the ground"
            " (commit a8fb0a6)"
        ),
        high=BELOW_ONE,
    )
    near_ground_m: float = setting(
        0.3,
        "Height over rest that is well above the ground: a descent there is flight, and no blow"
        " happens; what goes as far below its rest has left a table.",
        Measured(
            "a tenth counts 1.4 s of a landing as flight; there the error is 2.7 N",
            "no concealed case: flight NO_COMPENSATION_V_050 of appius-ground-effect",
            "6966152",
            "ges diagnose FLIGHTS --set prepare.near_ground_m=0.1",
        ),
        unit="m",
    )
    pause_s: float = setting(
        0.5,
        "Longest gap of the motion, or of the rangefinder, that is bridged, and time left out"
        " around every contact with the ground.",
        Measured(
            "a margin half as long around contacts names one more effect wrongly",
            "seed 29",
            "7312f51",
            "ges blind make --seed 29 --grid full --out DIR && "
            + RUN.replace("KEY=VALUE", "prepare.pause_s=0.25"),
        ),
        unit="s",
    )
    height_error_m: float = setting(
        0.02,
        "Height over its own rest at which a vehicle has left the ground, and least error of a"
        " rangefinder.",
        Convention("noise of a position; not measured"),
        unit="m",
    )
    thrust_smoothing_s: float = setting(
        0.15,
        "Smoothing of thrust and of climbs.",
        Convention(
            "faster is vibration; from 0.12 to 0.17 the loads of crazypad are told the same"
        ),
        unit="s",
    )
    rate_smoothing_s: float = setting(
        0.02,
        "Smoothing before a rate is differentiated.",
        Convention("two samples at 100 Hz"),
        unit="s",
    )
    lag_steps: int = setting(
        30,
        "Steps of delays up to the longest.",
        Numerical("a parabola finds the peak between steps"),
        low=3,
    )
    slow_Hz: float = setting(
        0.3,
        "Positions and voltages are as they were read below, and told by their cause above; what"
        " changes more slowly says nothing of a delay.",
        Convention("the longest thread that is tried, 2.4 m, swings at 0.32 Hz; not measured"),
        unit="Hz",
    )

    @property
    def slow_s(self) -> float:
        """Sd of the Gaussian whose amplitude is one half at the cut-off."""
        # a Gaussian of sd s passes exp(-2 (pi f s)^2) of a frequency f
        return math.sqrt(0.5 * math.log(2.0)) / (math.pi * self.slow_Hz)

    @property
    def descent_share(self) -> float:
        """Share of the usual thrust that is still flight well above the ground."""
        return 1.0 - self.lifting_share


@dataclasses.dataclass(frozen=True)
class LibrarySettings:
    """How candidates are laid out over the flights, besides what their descriptors ask for."""

    step_share: float = setting(
        0.1,
        "Step of a column over the usual size of its parameter, or over its range.",
        Numerical("columns are secants of nearly linear effects"),
    )
    command_quantiles: tuple[float, ...] = setting(
        (0.8, 0.95, 0.99, 0.999),
        "Quantiles of the commands in the air at which a ceiling of the rotors is tried.",
        Convention("from often to hardly ever reached; not measured"),
        high=1.0,
    )
    places_most: int = setting(
        36,
        "Most places over which something is looked for.",
        Numerical("limits time; doubled and halved, no answer of 11 sets changes"),
        low=1,
    )
    edge_slope: float = setting(
        0.4,
        "Slope of the ground from which a rangefinder's cone sees an edge.",
        Convention("lags were named over edges (commit cf4fae8); the value was not measured"),
    )


@dataclasses.dataclass(frozen=True)
class DesignSettings:
    """Windows of the weak form, columns, instruments."""

    window_shortest_s: float = setting(
        0.2,
        "Shortest support of a test function. Half or a quarter of it limits smoothing, grids, and"
        " what is left out around transients.",
        Convention("long against a sample, short against a manoeuvre; not measured"),
        unit="s",
    )
    window_updates: float = setting(
        3.0,
        "Support of a test function over the time between two values of the slowest stream; a value"
        " that stands as long was held, or clipped.",
        Convention(
            "a straight line between values is good to a part of the window, and lost packets come"
            " in ones and twos; not measured"
        ),
        unit="updates",
    )
    half_waves_most: int = setting(
        3, "Most half-waves of a test function.", Convention("7.5 Hz; not measured")
    )
    instruments: bool = setting(
        True, "Whether references serve as instruments.", Convention("off in an ablation")
    )
    nominal_tolerance: bool = setting(
        True,
        "Whether nominal parameters may move within prior sds.",
        Convention("off in an ablation"),
    )
    response_slowest_s: float = setting(
        0.5,
        "Slower changes of thrust are no answers to gusts, whose scatter shows within so long.",
        Measured(
            "thrust curves that were none were named, two of 700 names",
            "development seeds",
            "9b8a121",
            RUN.replace("KEY=VALUE", "design.response_slowest_s=5"),
        ),
        unit="s",
    )

    @property
    def response_windows(self) -> int:
        """Half windows that a controller's feedback response lasts."""
        return round(self.response_slowest_s / self.half_window_s)

    @property
    def half_window_s(self) -> float:
        """Half of the shortest window: by then a transient is over."""
        return 0.5 * self.window_shortest_s

    @property
    def coarsest_s(self) -> float:
        """A quarter of the shortest window: the coarsest grid, and the smoothing of states."""
        return 0.25 * self.window_shortest_s


@dataclasses.dataclass(frozen=True)
class NoiseSettings:
    """Autocorrelation and size of the residual of a channel."""

    whitening: bool = setting(
        True, "Whether windows are whitened.", Convention("off in an ablation")
    )
    autoregression_order: int = setting(
        3,
        "Order of the autoregression.",
        Convention("half-overlapping windows and a pole of turbulence"),
        unit="windows",
        low=1,
    )
    least_share: float = setting(
        1e-5,
        "Least noise, of weight and its like.",
        Numerical("no recording is better; doubled and halved, no answer of 11 sets changes"),
    )
    growths: tuple[float, ...] = setting(
        (0.0, 0.1, 0.3, 1.0, 3.0),
        "Growths of the noise's variance with covariate that are tried.",
        Numerical("half a decade apart"),
        low=0.0,
    )


@dataclasses.dataclass(frozen=True)
class EvidenceSettings:
    """What a window is worth, and priors of coefficients."""

    tempering: float = setting(
        0.4,
        "How much every whitened window counts.",
        Measured(
            "scores over blocks of time scatter 2.3 times as much as those of independent windows"
            " would; 0.4 names 35 of 69 sets abroad, 0.25 named 32",
            "61",
            "268f66f",
            RUN.replace("KEY=VALUE", "evidence.tempering=0.25"),
        ),
        high=1.0,
    )
    prior_share: float = setting(
        0.05,
        "Prior sd of an effect's size, of weight and its like, where it states none.",
        Convention("effects of a few percent are looked for; not measured"),
    )
    level_reach: float = setting(
        2.0,
        "Factor about a column's level within which its coefficient counts.",
        Convention("steps between levels (commit c60bbf5); not measured"),
        low=1.0,
    )


@dataclasses.dataclass(frozen=True)
class SearchSettings:
    """Which sets of candidates are compared, and their prior probabilities."""

    size_probabilities: tuple[float, ...] = setting(
        (0.5, 0.3, 0.13, 0.05, 0.02),
        "Prior probability of none, one, two ... causes; the largest set has one less than these.",
        Convention("every further cause is a third as likely; not measured"),
        high=1.0,
    )
    beam: int = setting(
        3,
        "How many of the best are followed: sets that grow, hidden effects, rivals that are flown.",
        Numerical("limits time; of 2 and of 6, no answer of 11 sets changes"),
        low=1,
    )
    log_odds_offset: float = setting(
        -0.36,
        "Offset of the stated log odds.",
        Measured(
            "names of development cases against their truth",
            "development seeds",
            "282ac6e",
            "ges blind calibrate DIR ...",
        ),
        low=-math.inf,
    )
    log_odds_slope: float = setting(
        0.597,
        "Slope of the stated log odds over those of the search.",
        Measured(
            "names of development cases against their truth",
            "development seeds",
            "282ac6e",
            "ges blind calibrate DIR ...",
        ),
    )


@dataclasses.dataclass(frozen=True)
class EstimateSettings:
    """The fit in full."""

    converged_sds: float = setting(
        0.02,
        "Step that ends a fit, and prior sd of what is held in one.",
        Numerical("results are the same from anywhere (commit 6a9f74a)"),
        unit="sds",
    )
    form_error: float = setting(
        0.12,
        "Sd of an effect's size, over it, that is due to its form alone.",
        Measured(
            "sizes of effects of other forms against their truth",
            "development seeds",
            "282ac6e",
            "ges blind score DIR",
        ),
    )
    prerequisite_share_least: float = setting(
        0.3,
        "Least size of a prerequisite, by which the size of what needs it is divided.",
        Numerical("no quotient beyond bounds; doubled and halved, no answer of 11 sets changes"),
        unit="usual size",
        high=1.0,
    )


@dataclasses.dataclass(frozen=True)
class DetectSettings:
    """Effects that need a procedure: gusts, loads on threads, a shifted balance."""

    gust_variance_ratio: float = setting(
        6.0,
        "Variance of means over what noise makes of it.",
        Measured(
            "flights with a drag come to 3.5, with gusts of 0.4 m/s to 12",
            "development seeds",
            "a1c672e",
            RUN.replace("KEY=VALUE", "detect.gust_variance_ratio=3"),
        ),
        low=1.0,
    )
    gust_draws: int = setting(16, "Gusts that are blown.", Numerical("noise of a sixth"), low=2)
    load_levels: int = setting(
        13,
        "Threads, or first places, of a load that are tried at once.",
        Numerical("steps of 3 %, which a second grid makes twenty times as fine"),
        low=3,
    )
    places_nearby: tuple[float, ...] = setting(
        (0.08, 0.04, 0.02),
        "Steps of thread and first place, over the distance behind.",
        Numerical("halved to centimetres"),
    )


@dataclasses.dataclass(frozen=True)
class LocateSettings:
    """Structure in residuals, and its location."""

    knots: int = setting(
        9, "Knots of a smooth function, in every variable.", Convention("not measured"), low=2
    )
    spread_least: float = setting(
        0.5,
        "Least spread of a place, a speed or the yaw rate that was flown over a range.",
        Convention("less is what the disturbance itself moves; not measured"),
        unit="m, m/s or rad/s",
    )
    height_spread_least: float = setting(
        0.3,
        "Least spread of a height that was flown over a range.",
        Convention("near a third; not measured"),
        unit="median height",
        high=1.0,
    )
    large_r2: float = setting(
        0.3,
        "Share of a channel's variance, predicted by a regime of flight, from which it is large.",
        Convention("near a third; not measured"),
        high=1.0,
    )
    r2_least: float = setting(
        0.1,
        "Least share of a channel's variance that a regime predicts, and of that of the residual"
        " where a finding is told to act.",
        Measured(
            "none of 257 nulls is so noisy over places, 6 of 86 effects outside of the library are",
            "development seeds",
            "9b8a121",
            RUN.replace("KEY=VALUE", "locate.r2_least=0.05"),
        ),
        high=1.0,
    )


@dataclasses.dataclass(frozen=True)
class DecideSettings:
    """Rules by which a name is accepted."""

    form_margin: float = setting(
        2.0,
        "How much more than what no model is right to a structure has to be.",
        Convention("no form is perfect; not measured"),
        low=1.0,
    )
    still_air_m_s: float = setting(
        0.3,
        "Least wind.",
        Convention("no air is stiller, nor any position more at rest"),
        unit="m/s",
    )
    least_thrust_share: float = setting(
        0.002,
        "Least error of a thrust that matters, over it; forces, moments and speeds follow.",
        Convention("no model is right to less; not measured"),
    )


@dataclasses.dataclass(frozen=True)
class AdviseSettings:
    """What these flights could have shown, and which flight is next."""

    power: float = probability(
        0.9,
        "Share of sets of flights in which the smallest detectable size is detected.",
        Convention("the usual power of a test, rounded up"),
    )
    duration_s: float = setting(
        30.0, "Length of a flight that is tried.", Convention("a short flight"), unit="s"
    )
    attitude_kp: float = setting(
        400.0,
        "Attitude gain it is flown with.",
        Convention("stands in for an integral action that trims unequal motors away"),
        unit="1/s^2",
    )
    settled_log_odds: float = setting(
        20.0,
        "Lead beyond which nothing more is gained.",
        Convention("no later flight undoes it; less would make manoeuvres equal"),
    )
    flights_most: int = setting(
        20, "Most flights that are recommended.", Convention("a day at the field"), low=1
    )


@dataclasses.dataclass(frozen=True)
class CalibrateSettings:
    """A vehicle file from healthy reference flights."""

    loss_sd: float = setting(
        0.1,
        "Prior sd of the gain of a motor.",
        Convention("propellers of small vehicles; not measured"),
    )
    cant_sd_rad: float = setting(
        0.01,
        "Prior sd of the cant of the rotors.",
        Convention("motors that stand straight to a degree, the mean of four; not measured"),
        unit="rad",
    )
    spread: float = setting(
        0.2,
        "Usual spread of a trim between flights, from commands, over the prior sd of it.",
        Convention("warm motors, a battery put back elsewhere: 2 % of a gain; not measured"),
    )
    smaller_spread: float = setting(
        0.25,
        "The same within a session, over that, and from rotor speeds, over that from commands.",
        Convention("small quadrotors (CrazyPAD): 0.5 % within a session, 2 % between"),
    )
    spread_factor_most: float = setting(
        20.0, "Spread over the usual one, or under it, at most.", Numerical("far above any use")
    )
    converged_share: float = setting(
        0.2, "Step over its prior sd that ends a calibration.", Numerical("commit 8cbfda3")
    )


@dataclasses.dataclass(frozen=True)
class ReportSettings:
    """What the report lists and draws."""

    alternatives: int = setting(
        4,
        "Most names that could stand in another's place.",
        Convention("a list that is read"),
        low=1,
    )
    tied_correlation: float = setting(
        0.9,
        "Correlation from which two numbers are known together.",
        Convention("not measured"),
        high=1.0,
    )
    bins: int = setting(
        6, "Cells of a variable on the map.", Convention("a map that is read"), low=2
    )
    horizon_s: float = setting(
        1.0,
        "Length of a rollout.",
        Convention("longer ones measure the start; not measured"),
        unit="s",
    )
    entries_by_channel: int = setting(
        3, "Most places listed of a channel.", Convention("a list that is read"), low=1
    )
    entries: int = setting(12, "Most places listed.", Convention("a list that is read"), low=1)
    terms: int = setting(
        3, "Most terms of a sparse form.", Convention("a form that is read"), low=1
    )


@dataclasses.dataclass(frozen=True)
class Settings:
    """All numbers of the method, by stage.

    Attributes
    ----------
    statistics, numerics : shared by all stages.
    prepare, library, design, noise, evidence, search, estimate, detect, locate, decide, advise,
        calibrate, report : of the room or step of that name.
    """

    statistics: StatisticsSettings = StatisticsSettings()
    numerics: NumericsSettings = NumericsSettings()
    prepare: PrepareSettings = PrepareSettings()
    library: LibrarySettings = LibrarySettings()
    design: DesignSettings = DesignSettings()
    noise: NoiseSettings = NoiseSettings()
    evidence: EvidenceSettings = EvidenceSettings()
    search: SearchSettings = SearchSettings()
    estimate: EstimateSettings = EstimateSettings()
    detect: DetectSettings = DetectSettings()
    locate: LocateSettings = LocateSettings()
    decide: DecideSettings = DecideSettings()
    advise: AdviseSettings = AdviseSettings()
    calibrate: CalibrateSettings = CalibrateSettings()
    report: ReportSettings = ReportSettings()


DEFAULTS = Settings()
_active = ContextVar("settings", default=DEFAULTS)


class _Active:
    """Proxy of the settings in force in this context.

    Each thread starts with the defaults, except those of :func:`ges.threads.each`, which have the
    settings of their caller. Two diagnoses in two threads therefore cannot change each other's.
    """

    def __getattr__(self, stage: str) -> Any:
        return getattr(_active.get(), stage)


settings = cast(Settings, _Active())


@contextlib.contextmanager
def using(overrides: Mapping[str, Any]) -> Iterator[Settings]:
    """Set numbers of this thread for the length of a ``with``.

    Parameters
    ----------
    overrides : by ``stage.name``; text is read as the number's type.

    Raises
    ------
    UsageError
        For a name that there is not, or a value that makes no sense, in one sentence.

    Examples
    --------
    >>> with using({"evidence.tempering": 0.5}):
    ...     settings.evidence.tempering
    0.5
    """
    changed_settings = _with(_active.get(), overrides)
    token = _active.set(changed_settings)
    try:
        yield changed_settings
    finally:
        _active.reset(token)


def parse(pairs: Iterable[str]) -> dict[str, Any]:
    """Parse numbers from text.

    Parameters
    ----------
    pairs : ``stage.name=value``.

    Returns
    -------
    By ``stage.name``, of the number's type.

    Raises
    ------
    UsageError
        As :func:`using` does, or where there is no ``=``.
    """
    given = dict(pair.partition("=")[::2] for pair in pairs)
    for pair in pairs:
        if "=" not in pair:
            raise UsageError(f"'{pair}' sets nothing; write KEY=VALUE, as evidence.tempering=0.5")
    set_to = {key: value for key, value, _ in setting_rows(_with(_active.get(), given))}
    return {key: set_to[key] for key in given}


def changed_settings() -> dict[str, Any]:
    """Return the numbers that differ from their defaults.

    Returns
    -------
    By ``stage.name``.
    """
    default = {key: value for key, value, _ in setting_rows(DEFAULTS)}
    return {key: value for key, value, _ in setting_rows(_active.get()) if value != default[key]}


def setting_rows(of: Settings) -> Iterator[tuple[str, Any, About]]:
    """Return every number with its description.

    Parameters
    ----------
    of : the settings.

    Yields
    ------
    ``stage.name``, value, and description.
    """
    for stage in dataclasses.fields(of):
        numbers = getattr(of, stage.name)
        for field in dataclasses.fields(numbers):
            yield (
                f"{stage.name}.{field.name}",
                getattr(numbers, field.name),
                field.metadata["about"],
            )


NOT_OF_THE_METHOD = ("numerics", "advise", "report")
"""Stages that hold no numbers of the method: limits of arithmetic, how a next flight is planned and
what is listed. One of these does more: ``advise.duration_s`` is also the length of the excerpts on
which recalibration begins.
"""


def of_method(of: Settings) -> list[str]:
    """Return the names of the numbers that a verdict depends on.

    Parameters
    ----------
    of : the settings.

    Notes
    -----
    Others are in stages that only plan or list, are numerical, or switch ablations.
    """
    return [
        key
        for key, value, about in setting_rows(of)
        if key.split(".")[0] not in NOT_OF_THE_METHOD
        and not isinstance(about.source, Numerical)
        and not isinstance(value, bool)
    ]


def _with(base: Settings, overrides: Mapping[str, Any]) -> Settings:
    known = {key: about for key, _, about in setting_rows(base)}
    for key, value in overrides.items():
        if key not in known:
            raise unknown_name("setting", key, known, "ges settings")
        stage, name = key.split(".")
        numbers = getattr(base, stage)
        read = _read(key, value, get_type_hints(type(numbers))[name], known[key])
        base = dataclasses.replace(base, **{stage: dataclasses.replace(numbers, **{name: read})})
    return base


def _read(key: str, value: Any, kind: Any, about: About) -> Any:
    """Return a value of this kind; several numbers are written with commas between."""
    several = kind not in (float, int, bool)
    asked = {
        bool: "true or false",
        int: f"a whole number, {about.allowed}",
        float: f"a number, {about.allowed}",
    }
    wanted = asked.get(kind, f"numbers with commas between, {about.allowed}")
    given = value.split(",") if several and isinstance(value, str) else value
    try:
        read = pydantic.TypeAdapter(kind).validate_python(given)
    except pydantic.ValidationError:
        raise UsageError(f"setting {key} cannot be '{value}'; give {wanted}") from None
    each = read if several else (read,)
    if kind is not bool and not all(about.low <= v <= about.high and v < math.inf for v in each):
        raise UsageError(f"setting {key} cannot be {value}; give {wanted}")
    return read
