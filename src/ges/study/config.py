"""The study's configuration: one model that validates it, makes its JSON schema and its page in the
docs.

Every value stands in ``config/default.yaml``; another file given with ``--configfile`` replaces
single values of it. Nothing has a default here, so no value has two homes. Names of simulator
numbers are those of ``ges.simulator.parameters.parameters()``.
"""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from ges.errors import UsageError
from ges.plain_yaml import read_yaml

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Fraction = Annotated[float, Field(gt=0, lt=1)]
Count = Annotated[int, Field(gt=0)]
Mode = Literal["none", "analytical", "oracle", "ml", "ml_direct", "ml_asym_clamp"]
ModelName = Literal[
    "analytical",
    "linear",
    "decision_tree",
    "random_forest",
    "gradient_boosting",
    "mlp",
    "lstm",
    "transformer",
]
Method = Literal[
    "stepwise",
    "sindy",
    "parameters",
    "boosting",
    "without-instruments",
    "without-whitening",
    "without-tolerance",
]


class Part(BaseModel):
    """A part of the configuration; keys that are not listed are errors."""

    model_config = ConfigDict(
        defer_build=True, extra="forbid", frozen=True, protected_namespaces=()
    )


class Quadrotor(Part):
    """Airframe that is flown: four rotors in a cross of equal arms."""

    mass_kg: Positive = Field(description="mass")
    ixx_kg_m2: Positive = Field(description="moment of inertia about body x")
    iyy_kg_m2: Positive = Field(description="moment of inertia about body y")
    izz_kg_m2: Positive = Field(description="moment of inertia about body z")
    arm_m: Positive = Field(description="distance of each rotor from the centre of mass")
    rotor_radius_m: Positive = Field(description="radius of each rotor")
    thrust_coefficient_N_s2: Positive = Field(description="T = k w^2 out of ground effect")
    torque_coefficient_Nm_s2: NonNegative = Field(description="reaction torque = k w^2")
    motor_time_constant_s: Positive = Field(description="first-order lag of rotor speed")
    max_rotor_speed_rad_s: Positive = Field(description="rotor speed at full command")
    gear_height_m: NonNegative = Field(description="feet below the rotor plane")

    def parameters(self) -> dict[str, float]:
        """Return the numbers of a simulated flight.

        Notes
        -----
        Rotors 1 and 2 turn counter-clockwise, at front right and rear left. Rotors 3 and 4 turn
        clockwise, at front left and rear right. Arms stand at 45 degrees to the body's axes.
        """
        flat = self.model_dump(exclude={"arm_m", "rotor_radius_m"})
        # arms stand at 45 degrees to the body's axes
        side = self.arm_m / 2**0.5
        for i, (x, y) in enumerate(((1, -1), (-1, 1), (1, 1), (-1, -1)), start=1):
            flat |= {
                f"rotor_{i}_x_m": x * side,
                f"rotor_{i}_y_m": y * side,
                f"rotor_{i}_radius_m": self.rotor_radius_m,
            }
        return flat


class Sensors(Part):
    """Noise of the sensors, standard deviation of a reading."""

    gyro_noise_rad_s: NonNegative = Field(description="gyro")
    range_noise_m: NonNegative = Field(description="rangefinder")
    range_max_m: Positive = Field(description="the rangefinder reads nothing beyond")
    rpm_noise_rad_s: NonNegative = Field(description="rotor speed")
    current_noise_A: NonNegative = Field(description="motor current")


class Controller(Part):
    """Firmware: what it holds, its gains, and when it trusts the network."""

    agl_ref_m: Positive = Field(description="height over ground to hold")
    altitude_kp: NonNegative = Field(description="height: proportional gain, 1/s^2")
    altitude_ki: NonNegative = Field(description="height: integral gain, 1/s^3")
    altitude_kd: NonNegative = Field(description="height: derivative gain, 1/s")
    altitude_filter_s: NonNegative = Field(
        description="height: time constant of the derivative filter"
    )
    attitude_kp: NonNegative = Field(description="roll and pitch: proportional gain, 1/s^2")
    attitude_kd: NonNegative = Field(description="roll and pitch: rate gain, 1/s")
    cutover_m: NonNegative = Field(description="ml: analytical below this range")
    trust_band: Positive = Field(description="ml: analytical outside this distance from it")


class TerrainShape(Part):
    """Procedural ground; each seed draws another one."""

    terrain_length_m: Positive = Field(description="length of the track that carries features")
    terrain_features_min: Count = Field(description="least number of features")
    terrain_features_max: Count = Field(description="greatest number of features")
    terrain_amplitude_min_m: NonNegative = Field(description="least height of a feature")
    terrain_amplitude_max_m: NonNegative = Field(description="greatest height of a feature")
    terrain_width_min_m: Positive = Field(description="least lateral width of a feature")
    terrain_width_max_m: Positive = Field(description="greatest lateral width of a feature")
    terrain_roughness_m: NonNegative = Field(description="amplitude of the fine roughness")
    terrain_roughness_length_m: Positive = Field(description="wavelength of the fine roughness")

    @model_validator(mode="after")
    def _ordered(self) -> TerrainShape:
        for low, high in (
            ("features_min", "features_max"),
            ("amplitude_min_m", "amplitude_max_m"),
            ("width_min_m", "width_max_m"),
        ):
            a, b = getattr(self, f"terrain_{low}"), getattr(self, f"terrain_{high}")
            if a > b:
                raise ValueError(f"terrain_{low} = {a:g} is above terrain_{high} = {b:g}")
        return self


class GroundEffect(Part):
    """True ground effect (parameters of the simulator's effect of that name)."""

    form: Literal["cheeseman_bennett", "hayden", "sanchez_cuevas", "exponential"] = Field(
        description="law"
    )
    amplitude: NonNegative = Field(description="scale of the increment")
    slope_exponent: NonNegative = Field(description="power of cos(slope)")
    curvature_gain_m: Finite = Field(description="gain of the curvature correction")
    low: Positive = Field(description="least factor")
    high: Positive = Field(description="greatest factor")
    c_a: NonNegative = Field(description="exponential form: gain at the ground")
    decay: Positive = Field(description="exponential form: decay per radius of height")

    def parameters(self) -> dict[str, float]:
        """Return the parameters as the simulator's effect takes them.

        Returns
        -------
        ``form`` by its number, the others as they are.
        """
        forms = get_args(type(self).model_fields["form"].annotation)
        return {**self.model_dump(), "form": float(forms.index(self.form))}


class Simulator(Part):
    """What is flown, over what, and how it is controlled."""

    vehicle: Quadrotor = Field(description="airframe")
    sensors: Sensors = Field(description="sensor noise")
    controller: Controller = Field(description="firmware")
    terrain: TerrainShape = Field(description="ground")
    ground_effect: GroundEffect = Field(description="true ground effect")
    dt_s: Positive = Field(description="step of the integration")
    control_every: Count = Field(description="steps between two runs of the firmware")

    def parameters(self) -> dict[str, float]:
        """Return the numbers of :class:`ges.simulator.flight.Flight`.

        Returns
        -------
        Those of vehicle, sensors, firmware, terrain and integration, flat.
        """
        parts = (self.sensors, self.controller, self.terrain)
        flat = {name: float(value) for part in parts for name, value in part.model_dump().items()}
        return {
            **self.vehicle.parameters(),
            **flat,
            "dt_s": self.dt_s,
            "control_every": float(self.control_every),
        }

    def effects(self) -> dict[str, dict[str, float]]:
        """Return the effects of :class:`ges.simulator.flight.Flight`.

        Returns
        -------
        Parameters of ``ground_effect`` alone.
        """
        return {"ground_effect": self.ground_effect.parameters()}


class SeedRange(Part):
    """Consecutive seeds: first, first + 1, ... (count of them)."""

    first: Annotated[int, Field(ge=1, le=2**31)] = Field(description="first seed")
    count: Count = Field(description="how many")

    def list(self) -> list[int]:
        """Return the seeds, rising."""
        return list(range(self.first, self.first + self.count))


class DataSeeds(Part):
    """Seeds of the data set."""

    train: SeedRange = Field(description="models are fitted to these")
    validation: SeedRange = Field(
        description="early stopping, the best pass, and every choice, the clamp threshold included"
    )
    test: SeedRange = Field(description="offline scores")

    def data(self) -> list[int]:
        """Return the seeds of the data set.

        Returns
        -------
        Train, validation and test, in this order.
        """
        return self.train.list() + self.validation.list() + self.test.list()


class Seeds(DataSeeds):
    """Seeds of terrain and noise. No seed serves two purposes."""

    calibration: SeedRange = Field(
        description="fit of the simulator's free numbers to published figures"
    )
    plan: SeedRange = Field(
        description="fit of the published flight plan's free numbers to published errors"
    )
    closed_loop_small: SeedRange = Field(description="closed loop: the small comparison")
    closed_loop: SeedRange = Field(description="closed loop: all other experiments")

    @model_validator(mode="after")
    def _disjoint(self) -> Seeds:
        for a, b in itertools.combinations(type(self).model_fields, 2):
            one, other = getattr(self, a), getattr(self, b)
            first = max(one.first, other.first)
            shared = min(one.first + one.count, other.first + other.count) - first
            if shared > 0:
                raise ValueError(
                    f"seed {first} is in both '{a}' and '{b}' ({shared} shared); every seed belongs"
                    " to one list"
                )
        return self


class FlightPlan(Part):
    """How the flights of a data set are flown."""

    mode: Mode = Field(description="feedforward mode")
    cruise_m_s: Finite = Field(description="forward speed")
    descent_m: NonNegative = Field(description="depth of the repeated descents")
    descent_period_s: Positive = Field(description="period of the descents")
    descent_duration_s: Positive = Field(
        description="length of a descent; the rest of its period is level"
    )
    start_min_m: NonNegative = Field(description="least place of the track where a flight begins")
    start_max_m: NonNegative = Field(
        description="greatest place of the track where a flight begins; each seed draws its own"
    )

    @model_validator(mode="after")
    def _ordered(self) -> FlightPlan:
        for low, high in (
            ("start_min_m", "start_max_m"),
            ("descent_duration_s", "descent_period_s"),
        ):
            a, b = getattr(self, low), getattr(self, high)
            if a > b:
                raise ValueError(f"{low} = {a:g} is above {high} = {b:g}")
        return self


class Data(Part):
    """The data set."""

    plans: dict[Literal["published", "consistent"], FlightPlan] = Field(
        min_length=1, description="flight plans"
    )
    duration_s: Positive = Field(description="length of a flight")
    rate_hz: Positive = Field(description="rows a second")
    flights_per_batch: Count = Field(description="flights a job; results do not depend on it")


class Window(Part):
    """What sequence models see: the present row and rows before it."""

    rows: Count = Field(description="rows of a window, the present one included")
    step: Count = Field(description="rows of the data set between two rows of a window")


class Fit(Part):
    """Rows that a model is fitted to."""

    train_rows: Count | None = Field(
        description="cap on training rows, shared equally by the flights; null takes all"
    )


class TreeFit(Fit):
    """Decision tree."""

    min_leaf_rows: Count = Field(description="fewest training rows in a leaf")


class ForestFit(TreeFit):
    """Random forest."""

    trees: Count = Field(description="trees")
    features_share: Annotated[float, Field(gt=0, le=1)] = Field(
        description="share of the features that a split looks at"
    )


class BoostingFit(TreeFit):
    """Histogram gradient boosting, stopped early on the validation rows."""

    trees: Count = Field(description="greatest number of trees")
    leaves: Count = Field(description="greatest number of leaves of a tree")
    learning_rate: Positive = Field(description="share of a tree's correction that is taken")
    patience: Count = Field(description="trees without gain on validation rows before stopping")


class NetworkFit(Fit):
    """Multilayer perceptron 13-64-32-1; its best pass on the validation rows is kept."""

    epochs: Count = Field(description="passes over the training rows")
    batch_rows: Count = Field(description="rows a step")
    learning_rate: Positive = Field(
        description="greatest step size; it falls to nothing over the passes"
    )


class LstmFit(NetworkFit):
    """Long short-term memory network over the window."""

    units: Count = Field(description="units of the layer")


class TransformerFit(LstmFit):
    """Transformer encoder over the window."""

    heads: Count = Field(description="attention heads; they divide the units")
    layers: Count = Field(description="encoder layers")

    @model_validator(mode="after")
    def _divides(self) -> TransformerFit:
        if self.units % self.heads:
            raise ValueError(f"heads = {self.heads} do not divide units = {self.units}")
        return self


AnyFit = Fit | TreeFit | ForestFit | BoostingFit | NetworkFit | LstmFit | TransformerFit


class Models(Part):
    """Models and their comparison."""

    names: list[ModelName] = Field(min_length=1, description="models to compare")
    seed: Annotated[int, Field(ge=0)] = Field(description="seed of every random number in training")
    horizon_s: NonNegative = Field(description="how far ahead the factor is predicted")
    block_s: Positive = Field(description="length of a block of the block-wise split")
    validation_rows: Count | None = Field(description="cap on validation rows; null takes all")
    test_rows: Count | None = Field(
        description="cap on test rows, the same rows for every model; null takes all"
    )
    resamples: Count = Field(description="draws of seeds behind an interval")
    firmware_plan: Literal["published", "consistent"] = Field(
        description="flight plan whose MLP the firmware flies"
    )
    trainings: list[Annotated[int, Field(ge=0)]] = Field(
        min_length=1, description="seeds of training of the networks of both plans that are flown"
    )
    window: Window = Field(description="window of the sequence models")
    linear: Fit = Field(description="linear regression")
    decision_tree: TreeFit = Field(description="decision tree")
    random_forest: ForestFit = Field(description="random forest")
    gradient_boosting: BoostingFit = Field(description="gradient boosting")
    mlp: NetworkFit = Field(description="multilayer perceptron")
    lstm: LstmFit = Field(description="LSTM")
    transformer: TransformerFit = Field(description="Transformer")


class Offline(Part):
    """Offline experiments."""

    horizons_s: list[NonNegative] = Field(min_length=1, description="horizon sweep")
    sweep_rows: Count = Field(description="training rows of the forest at each horizon")
    clearance_edges_m: list[NonNegative] = Field(
        min_length=2, description="edges of the clearance bins"
    )
    importance_rows: Count = Field(description="test rows whose features are shuffled")
    importance_repeats: Count = Field(description="shuffles of each feature")
    curve_shares: list[Positive] = Field(
        min_length=1, description="learning curves: rows over the cap of each model"
    )
    network_curve_shares: list[Positive] = Field(
        min_length=1, description="the same of the networks, whose fits take longest"
    )


class Pulse(Part):
    """Bias pulse."""

    bias: Finite = Field(description="height of the pulse")
    start_s: NonNegative = Field(description="start")
    duration_s: Positive = Field(description="length")
    window_edges_s: list[NonNegative] = Field(
        min_length=2, description="edges of the windows after its end"
    )


class PulseMap(Part):
    """Pulses of every height and length: which the vehicle recovers from."""

    biases: list[Finite] = Field(min_length=1, description="heights")
    durations_s: list[Positive] = Field(min_length=1, description="lengths")
    recovery_s: Positive = Field(description="time to recover after a pulse")
    judged_s: Positive = Field(description="last part of the recovery, in which it is judged")
    tolerance_m: Positive = Field(
        description="RMS difference of clearance from the unpulsed flight that counts as returned"
    )


class Retune(Part):
    """Gains of the height loop to try on validation seeds, as factors of the firmware's."""

    kp_factors: list[Positive] = Field(min_length=1, description="proportional")
    kd_factors: list[Positive] = Field(min_length=1, description="derivative")
    phase_margin_deg: NonNegative = Field(
        description="least phase margin of a candidate, far from the ground"
    )


class Ensemble(Part):
    """Walk through simulators that fit the published figures about as well."""

    steps: Count = Field(description="steps of the walk")
    stride: Positive = Field(
        description="standard deviation of a step, as a share of each number's bounds"
    )
    slack: Positive = Field(description="tolerances of the fit are widened by this")
    seed: Annotated[int, Field(ge=0)] = Field(description="seed of the walk")


class Flights(Part):
    """How every closed-loop flight is flown, and where its zones end."""

    duration_s: Positive = Field(description="length of a flight")
    cruise_m_s: Finite = Field(description="forward speed")
    low_clearance_m: Positive = Field(description="clearance below it counts as low")
    restricted_m: Positive = Field(description="clearance from which the restricted zone counts")


class ClosedLoop(Flights):
    """Closed-loop experiments."""

    modes: list[Mode] = Field(min_length=1, description="feedforward modes")
    clamp_thresholds: list[NonNegative] = Field(
        min_length=1,
        description="candidates for the asymmetric clamp: what the network may add to the formula",
    )
    biases: list[Finite] = Field(min_length=1, description="biases of the estimate")
    pulse: Pulse = Field(description="bias pulse")
    pulse_map: PulseMap = Field(description="map of bias pulses")
    ensemble: Ensemble = Field(description="simulators that fit as well")
    profile_gains_m: list[NonNegative] = Field(
        min_length=1, description="curvature gains over which the calibration's misfit is profiled"
    )
    retune: Retune = Field(description="search for a controller that does win")
    pole_factors: list[Positive] = Field(
        min_length=1, description="ground effect factors of the pole analysis"
    )
    slope_exponents: list[NonNegative] = Field(min_length=1, description="grid: slope exponents")
    curvature_factors: list[Finite] = Field(
        min_length=1, description="grid: curvature gains, as factors of the simulator's"
    )

    @model_validator(mode="after")
    def _pulse_fits(self) -> ClosedLoop:
        edges = self.pulse.window_edges_s
        if any(a >= b for a, b in itertools.pairwise(edges)):
            raise ValueError(f"pulse.window_edges_s = {edges} do not rise")
        end = self.pulse.start_s + self.pulse.duration_s + edges[-1]
        if end > self.duration_s:
            raise ValueError(
                f"the last window after the pulse ends at {end:g} s, the flight at duration_s ="
                f" {self.duration_s:g}"
            )
        return self


class Worlds(Part):
    """Sets that nobody tuned the diagnosis on."""

    every: Annotated[int, Field(ge=0)] = Field(
        description="so many sets of each world are one: 1 takes all, 0 none; what needs the extra"
        " 'simulators' or published flights that are not there is skipped with a reason"
    )
    seed: Annotated[int, Field(ge=0)] = Field(
        description="seed of the sets: below 1000 the development half, from 1000 on the other"
    )
    batches: Count = Field(description="jobs that share the sets")


class ConcealedProof(Part):
    """The proof with concealed effects."""

    grid: Literal["smoke", "glance", "tiny", "sample", "third", "full"] = Field(
        description="which composition of cases: 4, 12, 40, 60, 387, or all 1156"
    )
    seed: Annotated[int, Field(ge=0)] = Field(description="seed of the cases")
    cases_per_batch: Count = Field(description="cases that one job diagnoses")
    methods: list[Method] = Field(
        description="baselines and ablations on the same cases (sindy needs the extra 'baselines')"
    )
    worlds: Worlds = Field(description="sets of other simulators, real flights, a second author")


class Study(Part):
    """The whole configuration."""

    simulator: Simulator = Field(description="the simulated world")
    seeds: Seeds = Field(description="seed lists")
    data: Data = Field(description="data set")
    models: Models = Field(description="models")
    offline: Offline = Field(description="offline experiments")
    closed_loop: ClosedLoop = Field(description="closed-loop experiments")
    proof: ConcealedProof = Field(description="the proof with concealed effects")

    @model_validator(mode="after")
    def _flights_end_on_the_track(self) -> Study:
        track = self.simulator.terrain.terrain_length_m
        for name, plan in self.data.plans.items():
            end = plan.start_max_m + plan.cruise_m_s * self.data.duration_s
            if end > track:
                raise ValueError(
                    f"data.plans.{name}: a flight from start_max_m = {plan.start_max_m:g} ends at"
                    f" {end:g} m, beyond terrain_length_m = {track:g}; let flights begin earlier"
                )
        return self


def _model_at(location: tuple) -> type[BaseModel]:
    """The part of the model that a location of a validation error lies in."""
    part: Any = Study
    for key in location[:-1]:
        part = (
            part.model_fields[key].annotation
            if isinstance(part, type) and issubclass(part, Part)
            else get_args(part)[1]
        )
    return part


def _sentence(error: Mapping[str, Any]) -> str:
    # "[key]" is pydantic's mark where the key of a mapping is wrong
    key = ".".join(str(k) for k in error["loc"] if k != "[key]")
    if error["type"] == "extra_forbidden":
        known = list(_model_at(error["loc"]).model_fields)
        near = difflib.get_close_matches(str(error["loc"][-1]), known, n=1)
        return f"unknown key '{key}'; " + (
            f"did you mean '{near[0]}'?" if near else "known here: " + ", ".join(known)
        )
    if error["type"] == "missing":
        return f"key '{key}' is missing"
    message = error["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    if error["type"] == "value_error":
        return f"'{key}': {message}"
    return f"'{key}' is {error['input']!r}; allowed is {message}"


def validate(mapping: Mapping[str, Any]) -> Study:
    """Return the study of a configuration.

    Parameters
    ----------
    mapping : all keys with their values; none has a default.

    Raises
    ------
    UsageError
        Naming every wrong key, the value met and what is allowed.
    """
    try:
        return Study.model_validate(mapping)
    except ValidationError as errors:
        sentences = [_sentence(e) for e in errors.errors(include_url=False)]
        raise UsageError("configuration: " + "; ".join(sentences)) from None


def merged(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration with another laid over it.

    Parameters
    ----------
    base, over : values of ``over`` win, part by part, as Snakemake merges several config files.
    """
    both = {
        k
        for k in base
        if k in over and isinstance(base[k], Mapping) and isinstance(over[k], Mapping)
    }
    return {**base, **over, **{k: merged(base[k], over[k]) for k in both}}


def read(path: str | Path) -> dict[str, Any]:
    """Return the content of a configuration file.

    Raises
    ------
    GesError
        When the file cannot be read, is no YAML, or holds no keys.
    """
    content = read_yaml(Path(path), "configuration")
    if not isinstance(content, dict):
        raise UsageError(
            f"configuration {path}: holds {type(content).__name__}, not keys with values"
        )
    return content


def load(*paths: str | Path) -> Study:
    """Return the study of configuration files.

    Parameters
    ----------
    *paths : later files are laid over earlier ones.

    Raises
    ------
    UsageError
        When a file cannot be read, or the whole is not valid.
    """
    mapping: dict[str, Any] = {}
    for path in paths:
        mapping = merged(mapping, read(path))
    return validate(mapping)


def schema() -> dict[str, Any]:
    """Return the JSON schema of a whole configuration.

    Returns
    -------
    Draft 2020-12, as ``config/schema.json`` holds it.
    """
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **Study.model_json_schema()}


def rows(part: type[Part] = Study, prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield key, allowed values and meaning of every value.

    Parameters
    ----------
    part : part of the configuration.
    prefix : of its keys.
    """
    for name, field in part.model_fields.items():
        kind, key = field.annotation, prefix + name
        if isinstance(kind, type) and issubclass(kind, Part):
            yield from rows(kind, key + ".")
        elif getattr(kind, "__origin__", None) is dict:
            yield from rows(get_args(kind)[1], f"{key}.<{'|'.join(get_args(get_args(kind)[0]))}>.")
        else:
            yield key, _allowed(part, name), field.description or ""


def _allowed(part: type[Part], name: str) -> str:
    """What a value may be, in the words of the JSON schema."""
    spec = part.model_json_schema()["properties"][name]
    kinds = [_kind(s) for s in spec.get("anyOf", [spec])]
    return " or ".join(kinds)


def _kind(spec: Mapping[str, Any]) -> str:
    if "enum" in spec:
        return ", ".join(map(str, spec["enum"]))
    if spec.get("type") == "array":
        return f"list of {_kind(spec['items'])}"
    words = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
    return " ".join(
        [
            spec.get("type", "value"),
            *(f"{sign} {spec[k]:g}" for k, sign in words.items() if k in spec),
        ]
    )
