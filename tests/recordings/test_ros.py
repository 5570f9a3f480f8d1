"""ROS bags that the tests write: mavros on ROS 1 and ROS 2, PX4's own messages in mcap and db3."""

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ges.errors import GesError, UsageError
from ges.recordings.consistency import agreements
from ges.recordings.readers import Options, open_log

RC_OUT = "std_msgs/Header header\nuint16[] channels\n"
PX4 = {
    "VehicleAttitude": "uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q\n",
    "SensorCombined": "uint64 timestamp\nfloat32[3] gyro_rad\nfloat32[3] accelerometer_m_s2\n",
    "VehicleLocalPosition": (
        "uint64 timestamp\nuint64 timestamp_sample\nbool xy_valid\nbool z_valid\nbool v_xy_valid\n"
        "bool v_z_valid\nfloat32 x\nfloat32 y\nfloat32 z\nfloat32 vx\nfloat32 vy\nfloat32 vz\n"
    ),
    "ActuatorMotors": "uint64 timestamp\nuint64 timestamp_sample\nfloat32[12] control\n",
    "EscReport": "uint64 timestamp\nint32 esc_rpm\nuint8 actuator_function\n",
    "EscStatus": "uint64 timestamp\nuint8 esc_online_flags\npx4_msgs/EscReport[8] esc\n",
}


def _store(ros2: bool):
    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    types = get_types_from_msg(RC_OUT, "mavros_msgs/msg/RCOut")
    for name, text in PX4.items():
        types |= get_types_from_msg(text, f"px4_msgs/msg/{name}")
    store.register(types)
    return store


def _header(store, t_s, ros2):
    stamp = store.types["builtin_interfaces/msg/Time"](int(t_s), int(round((t_s % 1) * 1e9)))
    kind = store.types["std_msgs/msg/Header"]
    return kind(stamp=stamp, frame_id="map") if ros2 else kind(seq=0, stamp=stamp, frame_id="map")


def _mavros(store, motion, ros2):
    """Topic, message type and messages with their times, as mavros publishes them."""
    kind, covariance = store.types, np.zeros(9)

    def vector(v):
        return kind["geometry_msgs/msg/Vector3"](*map(float, v))

    def quaternion(q):
        return kind["geometry_msgs/msg/Quaternion"](*map(float, (q[1], q[2], q[3], q[0])))

    for k, t in enumerate(1000.0 + motion["t"]):
        head = _header(store, t, ros2)
        q, body = quaternion(motion["q"][k]), motion["rotation"][k].inv().apply(motion["v"][k])
        yield (
            "/mavros/imu/data",
            t,
            kind["sensor_msgs/msg/Imu"](
                header=head,
                orientation=q,
                orientation_covariance=covariance,
                angular_velocity=vector(motion["omega"][k]),
                angular_velocity_covariance=covariance,
                linear_acceleration=vector(motion["acc"][k]),
                linear_acceleration_covariance=covariance,
            ),
        )
        point = kind["geometry_msgs/msg/Point"](*map(float, motion["p"][k]))
        pose = kind["geometry_msgs/msg/PoseWithCovariance"](
            kind["geometry_msgs/msg/Pose"](point, q), np.zeros(36)
        )
        twist = kind["geometry_msgs/msg/TwistWithCovariance"](
            kind["geometry_msgs/msg/Twist"](vector(body), vector(motion["omega"][k])), np.zeros(36)
        )
        odometry = kind["nav_msgs/msg/Odometry"](head, "base_link", pose, twist)
        yield "/mavros/local_position/odom", t, odometry
        pulses = np.round(1000 + 1000 * motion["u"][k]).astype(np.uint16)
        yield "/mavros/rc/out", t, kind["mavros_msgs/msg/RCOut"](head, pulses)


def _px4(store, motion, ned, order):
    kind = store.types
    for k, t in enumerate(motion["t"]):
        us, now = int(5e6 + 1e6 * t), 1000.0 + t
        f32 = np.float32
        yield (
            "/drone1/fmu/out/vehicle_attitude",
            now,
            kind["px4_msgs/msg/VehicleAttitude"](us, us, ned["q"][k].astype(f32)),
        )
        yield (
            "/drone1/fmu/out/sensor_combined",
            now,
            kind["px4_msgs/msg/SensorCombined"](
                us, ned["omega"][k].astype(f32), ned["acc"][k].astype(f32)
            ),
        )
        yield (
            "/drone1/fmu/out/vehicle_local_position_v1",
            now,
            kind["px4_msgs/msg/VehicleLocalPosition"](
                us, us, True, True, True, True, *map(float, (*ned["p"][k], *ned["v"][k]))
            ),
        )
        control = np.full(12, np.nan, dtype=f32)
        control[:4] = motion["u"][k]
        yield (
            "/drone1/fmu/out/actuator_motors",
            now,
            kind["px4_msgs/msg/ActuatorMotors"](us, us, control),
        )
        reports = [
            kind["px4_msgs/msg/EscReport"](us, int(8000 * motion["u"][k][m - 1]), 100 + m)
            for m in order
        ]
        spare = [kind["px4_msgs/msg/EscReport"](0, 0, 0)] * 4
        yield (
            "/drone1/fmu/out/esc_status",
            now,
            kind["px4_msgs/msg/EscStatus"](us, 15, reports + spare),
        )


def _bag(path, messages, store, ros2=True, plugin=StoragePlugin.MCAP):
    writer = Writer2(path, version=9, storage_plugin=plugin) if ros2 else Writer1(path)
    with writer:
        connections = {}
        for topic, t, message in messages:
            name = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            data = (store.serialize_cdr if ros2 else store.serialize_ros1)(message, name)
            writer.write(connections[topic], int(t * 1e9), data)
    return path


def _same_motion(frame, motion, tolerance):
    for form, key in (("p_{}_m", "p"), ("v_{}_m_s", "v"), ("acc_{}_m_s2", "acc")):
        got = frame[[form.format(a) for a in "xyz"]].to_numpy()
        np.testing.assert_allclose(got, motion[key], atol=tolerance)
    tied = [a for a in agreements(frame) if "commands" not in a.what and "rotor" not in a.what]
    assert len(tied) == 9 and min(a.correlation for a in tied) > 0.9


@pytest.mark.parametrize("ros2", [False, True])
def test_mavros(tmp_path, motion, ros2):
    store = _store(ros2)
    path = tmp_path / ("f" if ros2 else "f.bag")
    log = open_log(_bag(path, _mavros(store, motion, ros2), store, ros2))
    frame = log.frame()
    _same_motion(frame, motion, 1e-6)
    np.testing.assert_allclose(frame["u_4"], motion["u"][:, 3], atol=1e-3)
    assert "topics are read by the map 'mavros'" in log.notes
    assert any("pulses are taken as 1000 to 2000 us" in note for note in log.notes)
    stated = open_log(path, Options(pwm=(1100.0, 1900.0))).frame()
    asked = np.clip((1000 * motion["u"][:, 3] - 100) / 800, 0, 1)
    np.testing.assert_allclose(stated["u_4"], asked, atol=2e-3)


@pytest.mark.parametrize("file", ["folder", "mcap"])
def test_px4_messages_go_by_the_rules_of_a_px4_log(tmp_path, motion, ned, file):
    store = _store(True)
    path = _bag(tmp_path / "f", _px4(store, motion, ned, (2, 4, 1, 3)), store)
    if file == "mcap":
        path = next(path.glob("*.mcap"))
    log = open_log(path)
    frame = log.frame()
    _same_motion(frame, motion, 1e-4)
    for i in range(4):
        asked = 8000 * motion["u"][:, i] * np.pi / 30
        np.testing.assert_allclose(frame[f"rotor_speed_{i + 1}_rad_s"], asked, atol=0.2)
    assert "rotor speeds of motors 1 to 4 are readings 3, 1, 4, 2 of esc_status" in log.notes


def test_a_database_without_definitions_needs_them(tmp_path, motion, ned):
    """Until ROS 2 Iron a .db3 does not say what its messages are."""
    import sqlite3

    store = _store(True)
    folder = _bag(
        tmp_path / "f", _px4(store, motion, ned, (1, 2, 3, 4)), store, plugin=StoragePlugin.SQLITE3
    )
    (path,) = folder.glob("*.db3")
    with sqlite3.connect(path) as database:
        database.execute("DELETE FROM message_definitions")
    database.close()
    with pytest.raises(GesError, match="definitions"):
        open_log(path)
    for name, text in PX4.items():
        file = tmp_path / "msgs" / "px4_msgs" / "msg" / f"{name}.msg"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (tmp_path / "map.yaml").write_text(
        "definitions: msgs\ntopics:\n"
        "  - {topic: fmu/out/vehicle_attitude, uorb: vehicle_attitude}\n"
        "  - {topic: fmu/out/actuator_motors, uorb: actuator_motors}\n"
    )
    log = open_log(path, Options(tmp_path / "map.yaml"))
    np.testing.assert_allclose(log.frame()["u_2"], motion["u"][:, 1], atol=1e-6)


def test_a_bag_of_two_vehicles_or_of_no_known_topic_asks_for_a_map(tmp_path, motion):
    store = _store(True)
    messages = list(_mavros(store, motion, True))[:300]
    two = [(f"/{who}{topic}", t, m) for who in ("a", "b") for topic, t, m in messages]
    with pytest.raises(UsageError, match="holds 2 topics mavros/imu/data .*of which vehicle"):
        open_log(_bag(tmp_path / "two", two, store))
    other = [("/chatter", t, m) for topic, t, m in messages if topic.endswith("imu/data")]
    path = _bag(tmp_path / "other", other, store)
    with pytest.raises(UsageError, match=r"no shipped topic map knows these topics \(/chatter\)"):
        open_log(path)
    (tmp_path / "map.yaml").write_text(
        "topics:\n  - topic: chatter\n    fields: {angular_velocity.q: {to: omega_x_rad_s}}\n"
    )
    with pytest.raises(UsageError, match="topic /chatter .* has not all of the fields"):
        open_log(path, Options(tmp_path / "map.yaml"))
    (tmp_path / "map.yaml").write_text("topics:\n  - {topic: chatter, field: {}}\n")
    with pytest.raises(UsageError, match="unknown key 'field'; did you mean 'fields'"):
        open_log(path, Options(tmp_path / "map.yaml"))
