"""ROS 1 bags (.bag) and ROS 2 bags (folder, .mcap, .db3), by rosbags and a topic map (YAML)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pydantic

from ges.conventions import FEWEST_ROTORS, MAX_ROTORS
from ges.errors import GesError, UsageError
from ges.recordings.readers import px4, rotor_order
from ges.recordings.readers.log import (
    Log,
    Options,
    Stream,
    from_first_sample,
    increasing,
    named_streams,
    optional_module,
)
from ges.recordings.readers.maps import Column, convert, in_contract, load_map, presets

_MAGICS = (b"#ROSBAG V2.0", b"\x89MCAP0\r\n", b"SQLite format 3\0")
_PULSE = re.compile(r"pwm_us_([1-9]\d*)")
_PULSE_RANGE_US = (1000.0, 2000.0)
_LONGEST_ARRAY = 16

# Which topics there are, only a running program knows.
if TYPE_CHECKING:
    _Uorb = str
else:
    _Uorb = Literal[(*px4.TOPICS, "")]


class Topic(pydantic.BaseModel):
    """What one topic holds.

    Attributes
    ----------
    topic : its name, or the end of it behind a namespace.
    fields : columns by field of the message (``pose.position.x``, ``channels[0]``). Besides the
        contract's columns there are ``v_body_x_m_s`` ..., velocity along the body's axes, and
        ``pwm_us_1`` ..., pulses to the motors.
    uorb : instead of fields, the PX4 topic whose message this is; it is read as in a PX4 log.
    axes : ``enu-flu`` or ``ned-frd``, as in a column map.
    held : whether set-points stay in force until the next one.
    """

    model_config = pydantic.ConfigDict(extra="forbid")

    topic: str
    fields: dict[str, Column] = {}
    uorb: _Uorb = ""
    axes: Literal["enu-flu", "ned-frd"] = "enu-flu"
    held: bool = False


class TopicMap(pydantic.BaseModel):
    """A topic map file.

    Attributes
    ----------
    about : whose bags these are.
    autopilot : what wrote them.
    topics : topics to read; a column that several give is taken from the first.
    definitions : folder with ``PACKAGE/msg/NAME.msg`` beside the map file, for bags without their
        own (older .db3).
    """

    model_config = pydantic.ConfigDict(extra="forbid")

    about: str = ""
    autopilot: str = ""
    topics: list[Topic] = pydantic.Field(min_length=1)
    definitions: Path | None = None

    @pydantic.field_validator("definitions")
    @classmethod
    def _folder_of(cls, folder: Path | None) -> Path | None:
        if folder is not None and (folder.is_absolute() or ".." in folder.parts):
            raise ValueError(f"'{folder}' must lie beside the map file; give its name alone")
        return folder


def _matches(wanted: str, name: str) -> bool:
    """Tell whether a bag's topic is the wanted one, in any namespace and version (``_v1``)."""
    # PX4 marks topics whose messages have changed by a version
    name = re.sub(r"_v\d+$", "", name)
    return name == wanted or name.endswith("/" + wanted.lstrip("/"))


def _getter(path: str) -> Callable[[Any], Any]:
    """Make a function that takes a field such as ``esc[0].esc_rpm`` out of a message."""
    steps = [name or k for name, k in re.findall(r"(\w+)|\[(\d+)\]", path)]

    def take(message: Any) -> Any:
        for step in steps:
            message = message[int(step)] if step.isdigit() else getattr(message, step)
        return message

    return take


def _numeric_fields(message: Any, prefix: str = "") -> Iterator[str]:
    """List the paths of all numbers in a message, those of short arrays one by one."""
    for name in getattr(message, "__dataclass_fields__", {}):
        if name.startswith("__"):
            continue
        value, path = getattr(message, name), f"{prefix}{name}"
        if isinstance(value, np.ndarray | list) and len(value) <= _LONGEST_ARRAY:
            for k, item in enumerate(value):
                if hasattr(item, "__dataclass_fields__"):
                    yield from _numeric_fields(item, f"{path}[{k}].")
                elif isinstance(item, int | float | np.number):
                    yield f"{path}[{k}]"
        elif hasattr(value, "__dataclass_fields__"):
            yield from _numeric_fields(value, f"{path}.")
        elif isinstance(value, int | float | np.number):
            yield path


def _stamp_s(message: Any, received_ns: int) -> float:
    """Give the time of a message, s: its header's, else when it was received."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    # zero is a header that nobody filled in
    if stamp is not None and (stamp.sec, stamp.nanosec) != (0, 0):
        return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return 1e-9 * received_ns


class _Bag:
    """An open bag."""

    def __init__(self, reader: Any, name: str) -> None:
        self._reader, self.name = reader, name
        self.topics = {c.topic: c.msgtype for c in reader.connections}

    def find(self, wanted: str) -> str | None:
        """Find the bag's topic that matches; None without."""
        matching = sorted({name for name in self.topics if _matches(wanted, name)})
        if len(matching) > 1:
            raise UsageError(
                f"{self.name} holds {len(matching)} topics {wanted} ({', '.join(matching[:3])}): of"
                " which vehicle? Give a topic map with whole names"
            )
        return matching[0] if matching else None

    def read(self, topic: str, fields: Sequence[str] | None) -> dict[str, np.ndarray]:
        """Read fields of all messages of a topic, each (n,), with ``t_s``.

        All numbers are read if no fields are named.
        """
        connections = [c for c in self._reader.connections if c.topic == topic]
        names = None if fields is None else list(fields)
        rows: list[list[float]] = []
        times: list[float] = []
        for connection, received_ns, data in self._reader.messages(connections=connections):
            message = self._reader.deserialize(data, connection.msgtype)
            # the first message shows what there is
            if names is None:
                names = list(_numeric_fields(message))
            if not rows:
                take = [_getter(name) for name in names]
            try:
                rows.append([float(t(message)) for t in take])
            except (AttributeError, IndexError, TypeError, ValueError) as error:
                raise UsageError(
                    f"{self.name}: topic {topic} ({connection.msgtype}) has not all of the fields"
                    f" {', '.join(names)} ({error}); mend the topic map"
                ) from None
            times.append(_stamp_s(message, received_ns))
        table = np.array(rows, dtype=float).reshape(len(rows), len(names or ())).T
        return {"t_s": np.array(times), **dict(zip(names or (), table, strict=True))}


def _typestore(mapping: TopicMap, folder: Path | None) -> Any:
    """Collect types of messages for a bag that does not hold their definitions."""
    typesys = optional_module("rosbags.typesys", "ros", "ROS bags")
    store = typesys.get_typestore(typesys.Stores.LATEST)
    if mapping.definitions is not None:
        folder = (folder or Path()) / mapping.definitions
        files = sorted(folder.glob("*/msg/*.msg"))
        if not files:
            raise UsageError(f"{folder} holds no PACKAGE/msg/NAME.msg; mend 'definitions'")
        types: dict[str, Any] = {}
        for file in files:
            name = f"{file.parts[-3]}/msg/{file.stem}"
            types |= typesys.get_types_from_msg(file.read_text("utf-8"), name)
        # types that the library knows already stay as they are
        store.register({n: t for n, t in types.items() if n not in store.fielddefs})
    return store


def _map_for(bag: _Bag, options: Options) -> tuple[TopicMap, str]:
    """Choose the map that the user names, else the shipped one that knows most topics."""
    if options.mapping is not None:
        return load_map(options.mapping, TopicMap), ""
    matched = {
        name: sum(any(_matches(t.topic, n) for n in bag.topics) for t in mapping.topics)
        for name, mapping in presets(TopicMap).items()
    }
    best = max(matched, key=lambda name: matched[name])
    if matched[best] == 0:
        topics = ", ".join(sorted(bag.topics)[:8]) or "none"
        raise UsageError(
            f"{bag.name}: no shipped topic map knows these topics ({topics}); give --map MAP.yaml"
            f" (docs/importing.md shows one) or a preset: {', '.join(matched)}"
        )
    return presets(TopicMap)[best], f"topics are read by the map '{best}'"


def _pulses(
    columns: dict[str, np.ndarray], options: Options, notes: list[str]
) -> dict[str, np.ndarray]:
    """Convert pulses to the motors to commands."""
    pulses = {name: m for name in columns if (m := _PULSE.fullmatch(name))}
    if not pulses:
        return columns
    low, high = options.pwm or _PULSE_RANGE_US
    if options.pwm is None:
        notes.append(
            f"motor pulses are taken as {low:g} to {high:g} us for 0 to 1; --pwm states another"
            " range"
        )
    out = {name: v for name, v in columns.items() if name not in pulses}
    for name, number in pulses.items():
        out[f"u_{number.group(1)}"] = np.clip((columns[name] - low) / (high - low), 0.0, 1.0)
    return out


def _mapped(bag: _Bag, mapping: TopicMap, options: Options, notes: list[str]) -> dict[str, Stream]:
    """Give streams of the topics that are mapped field by field."""
    streams: dict[str, Stream] = {}
    taken: set[str] = set()
    for entry in (t for t in mapping.topics if not t.uorb):
        topic = bag.find(entry.topic)
        if topic is None:
            continue
        values = bag.read(topic, list(entry.fields))
        t_s = values.pop("t_s")
        good, dropped = increasing(t_s)
        if good.sum() < 2:
            continue
        notes += [f"{topic}: {dropped}"] if dropped else []
        columns = {c.to: convert(values[f][good], c) for f, c in entry.fields.items()}
        columns = in_contract(_pulses(columns, options, notes), entry.axes)
        columns = {name: v for name, v in columns.items() if name not in taken}
        # a column of NaN throughout does not keep another topic from giving it
        taken |= {name for name, v in columns.items() if np.isfinite(v).any()}
        for name, stream in named_streams(t_s[good], columns, topic).items():
            # what is asked for is in force until the next message
            held = entry.held or name == "reference"
            key = name if name not in streams else f"{name} ({topic})"
            streams[key] = Stream(stream.t_s, stream.columns, topic, held)
    return from_first_sample(streams)


def _uorb(
    bag: _Bag, mapping: TopicMap, options: Options, notes: list[str]
) -> tuple[dict[str, Stream], dict[str, str]]:
    """Give streams of the topics that are PX4's own messages, by PX4's own clock.

    With them comes what is logged and not used, by column.
    """
    tables = {}
    for entry in (t for t in mapping.topics if t.uorb):
        topic = bag.find(entry.topic)
        if topic is not None and entry.uorb not in tables:
            table = bag.read(topic, None)
            if len(table["t_s"]) > 1 and "timestamp" in table:
                tables[entry.uorb] = table
    if not tables:
        return {}, {}
    # stamps of PX4's own clock, in microseconds
    log = px4.Uorb(bag.name, min(float(t["timestamp"][0]) for t in tables.values()))
    for name, table in tables.items():
        log.add(name, 0, table)
    streams = px4.uorb_streams(log, options)
    notes += log.notes
    return streams, log.unusable


def _with_ordered_speeds(
    streams: dict[str, Stream], options: Options, notes: list[str]
) -> dict[str, Stream]:
    """Leave out rotor speeds whose order the commands do not confirm."""
    command, speed = streams.get("command"), streams.get("rotor_speed")
    if command is None or speed is None:
        return streams
    if options.rotor_order:
        order = [f"rotor_speed_{k}_rad_s" for k in options.order_of(len(speed.columns)) or ()]
        columns = {f"rotor_speed_{i}_rad_s": speed.columns[name] for i, name in enumerate(order, 1)}
        return streams | {"rotor_speed": Stream(speed.t_s, columns, speed.source)}
    why, _ = rotor_order.check_order(command, speed)
    if why:
        notes.append(
            "the rotor speeds are not used, as the bag does not say which motor each is of and"
            f" {why}; if you know it, give the order, e.g. --rotor-order 1,2,3,4"
        )
        return {name: s for name, s in streams.items() if name != "rotor_speed"}
    return streams


def _rotors(streams: Mapping[str, Stream]) -> int:
    """Count the motors that are commanded."""
    return len(streams["command"].columns) if "command" in streams else 4


class Ros:
    """Reader of ROS 1 and ROS 2 bags.

    Attributes
    ----------
    name, title, advice : as of :class:`~ges.recordings.readers.log.Reader`.
    """

    name = "ros"
    title = "ROS bag (.bag, .mcap, .db3 or folder)"
    advice = {
        "attitude": "/mavros/imu/data, or /fmu/out/vehicle_attitude",
        "position": "/mavros/local_position/pose, or /fmu/out/vehicle_local_position",
        "velocity": "/mavros/local_position/velocity_local, or /fmu/out/vehicle_local_position",
        "rates": "/mavros/imu/data, or /fmu/out/sensor_combined",
        "acceleration": "/mavros/imu/data, or /fmu/out/sensor_combined",
        "command": "/mavros/rc/out, or /fmu/out/actuator_motors (in dds_topics.yaml)",
        "rotor_speed": "/mavros/esc_status, or /fmu/out/esc_status (in dds_topics.yaml)",
        "battery": "/mavros/battery, or /fmu/out/battery_status",
        "reference": "/mavros/setpoint_position/local, or /fmu/in/trajectory_setpoint",
        "range": "a rangefinder's topic, named in a topic map",
    }

    def sniff(self, head: bytes, path: Path) -> bool:
        """Tell whether it begins as a bag, or is a folder with ``metadata.yaml``."""
        return head.startswith(_MAGICS) or (path.is_dir() and (path / "metadata.yaml").exists())

    def read(self, path: Path, options: Options) -> Log:
        """Read a bag; t = 0 at its first sample.

        Parameters
        ----------
        path : the bag, a file or a folder.
        options : ``mapping``, ``pwm`` and ``rotor_order`` are used.

        Returns
        -------
        Streams in ENU and FLU, by the topic map.

        Raises
        ------
        GesError
            When rosbags is not installed, or the bag is damaged or lacks definitions.
        UsageError
            When no map knows its topics, a field is missing, or ``rotor_order`` does not suit.
        """
        highlevel = optional_module("rosbags.highlevel", "ros", "ROS bags")
        # shipped maps are chosen by an open bag's topics: only the user's own brings definitions
        mapping = TopicMap.model_construct(definitions=None)
        if options.mapping is not None:
            mapping = load_map(options.mapping, TopicMap)
        folder = Path(options.mapping).parent if options.mapping is not None else None
        store = _typestore(mapping, folder)
        notes: list[str] = []
        try:
            with highlevel.AnyReader([path], default_typestore=store) as reader:
                bag = _Bag(reader, path.name)
                mapping, chosen = _map_for(bag, options)
                notes += [chosen] if chosen else []
                uorb, unusable = _uorb(bag, mapping, options, notes)
                mapped = _with_ordered_speeds(_mapped(bag, mapping, options, notes), options, notes)
        except (GesError, OSError):
            raise
        except KeyError as error:
            raise GesError(
                f"{path.name} does not define its message {error}; record with 'ros2 bag record -s"
                " mcap', or give 'definitions' in the topic map"
            ) from None
        except Exception as error:
            # rosbags meets damage with whatever error its bytes lead to
            raise GesError(
                f"{path.name} is damaged: the bag cannot be read ({type(error).__name__}: {error})"
            ) from None
        streams = mapped | uorb
        if not streams:
            raise GesError(
                f"{path.name} holds none of the topics that the map names; it has"
                f" {', '.join(sorted(bag.topics)[:8]) or 'none'}"
            )
        rotors = _rotors(streams)
        can = FEWEST_ROTORS <= rotors <= MAX_ROTORS
        kind = "" if can else f"a vehicle with {rotors} motors"
        return Log(
            path.stem,
            self.name,
            mapping.autopilot,
            streams,
            {},
            tuple(notes),
            f"this is a log of {kind}; multirotors can be diagnosed" if kind else "",
            unusable,
        )
