"""ROS recordings without ROS: joint states, plans and controller states in MCAP files, bags and databases.

A log has a row for each message. A plan is a polynomial between its points, as executed by ros2_controllers, and has a
row every 2 ms and at each point.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...core.errors import MissingExtraError, NotFoundError, TrajectoryError
from ...core.numbers import number
from ...core.text import Argument, listed, spell
from ...core.third_party import third_party_errors
from ...core.typing import Array
from ..column_names import SUFFIX, date_note
from ..smoothing import FEWEST, spline_rates
from .columnar_file import ArrayFile
from .recording_bounds import BoundedFile, check_chunks, check_folder, recording_database, values_within

STEP = 2e-3
"""Time step between the points of a plan [s]."""
_MAX_ROWS = 1_000_000
"""Largest number of rows of a plan; longer plans have a larger step."""
_MIN_GAP_OF_STEP = 0.01
"""Smallest distance in time between a row and a point of a plan, in steps."""

_CONTROLLER_STATE_TYPE = "control_msgs/msg/JointTrajectoryControllerState"
_OLD_CONTROLLER_STATE = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
"""
_CONTROLLER_STATE = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
"""
_DEFINITIONS = {
    "moveit_msgs/msg/RobotTrajectory": (
        "trajectory_msgs/JointTrajectory joint_trajectory\ntrajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory",
    ),
    _CONTROLLER_STATE_TYPE: (_CONTROLLER_STATE, _OLD_CONTROLLER_STATE),
}
"""Message definitions, the newest first, for databases before ROS 2 Iron, which lack them."""

Topics = Mapping[str, tuple[str, int]]
"""Message type and number of messages by topic."""


def ros_file(path: Path, topic: str | None = None, command_topic: str | None = None) -> ArrayFile:
    """Motion from one topic, by default the topic with most messages; ``NAME:reference`` is a controller's reference.

    ``command_topic`` has joint states whose positions are commands; a command holds until the next command.
    Raises NotFoundError, MissingExtraError and TrajectoryError.
    """
    if not path.exists():
        raise NotFoundError(f"no recording {str(path)!r}. Give the path of a .mcap, .bag or .db3, or a rosbag2 folder.")
    read_messages = _reader_of(path)
    commands: list[Any] = []
    choice: list[str] = []  # set by the reader, which knows the topics, through choose()

    def choose(topics: Topics) -> str:
        choice[:] = _choose_topic(path, topics, topic, Argument("topic"))
        topic_name, *_ = choice
        return topic_name

    def choose_commands(topics: Topics) -> str:
        topic_name, *_ = _choose_topic(path, topics, command_topic, Argument("command_topic"))
        return topic_name

    with third_party_errors(lambda reason: TrajectoryError(f"{path}: cannot be read as a recording of ROS: {reason}.")):
        if command_topic is not None:
            commands = list(read_messages(path, choose_commands))
        messages = list(read_messages(path, choose))
        name, message_type, part, *notes = choice
        where = f"{path}, topic {name}"
        if not messages:
            raise TrajectoryError(f"{where}: has no messages.")
        if message_type == "JointState":
            header, table = _joint_states(messages, where)
        elif message_type == "JointTrajectoryControllerState":
            header, table = _controller_states(messages, part, where)
        else:
            header, table, note = _plan(messages, where)
            notes.append(note)
        if command_topic is not None:
            header, table = _with_commands(header, table, commands, messages[0], f"{path}, topic {command_topic}")
    epoch = 0  # [ns] since 1970; 0 for a plan
    is_recorded = message_type in ("JointState", "JointTrajectoryControllerState")
    if is_recorded:
        stamp = messages[0].header.stamp
        notes += date_note(_seconds(stamp))
        epoch = _nanoseconds(stamp)
    files = [path]
    if not path.is_file():  # a folder of rosbag2
        files = [entry for entry in path.iterdir() if entry.is_file()]
    size = sum(file.stat().st_size for file in files)
    is_plan = not is_recorded or bool(part)
    return replace(ArrayFile.from_table(path, header, table, size, notes), epoch=epoch, plan=is_plan)


def _reader_of(path: Path) -> Callable[[Path, Callable[[Topics], str]], Iterator[Any]]:
    """Reader of a recording, by the ending of its name."""
    ending = path.suffix.lower()
    if ending == ".mcap":
        return _mcap
    if ending == ".db3" or (ending != ".bag" and path.is_file()):
        return _database
    return _bag


def _choose_topic(path: Path, topics: Topics, requested: str | None, argument: Argument) -> list[str]:
    """Four texts: name of the topic, its type, the selected part or "", and a note if other topics are possible.

    ``argument`` is that of the ``requested`` topic, for messages.
    """
    name, _, part = (requested or "").partition(":")
    type_by_topic = dict[str, str]()
    readable_topics = list[str]()
    topics_with_types = list[str]()
    for topic, (full_type, message_count) in topics.items():
        topics_with_types.append(f"{topic} ({full_type})")
        _, _, short_type = full_type.rpartition("/")
        type_by_topic[topic] = short_type
        if short_type in _MESSAGE_TYPES and message_count:
            readable_topics.append(topic)
    topics_text = listed(topics_with_types) or "none"
    if requested is None and not readable_topics:
        raise TrajectoryError(f"{path}: has no messages of the types {listed(_MESSAGE_TYPES)}. Topics: {topics_text}.")
    if requested is not None and name not in readable_topics:
        raise TrajectoryError(f"{path}: has no motion in a topic {name!r}, {{0}}. Topics: {topics_text}.", argument)
    if part and (part != "reference" or type_by_topic[name] != "JointTrajectoryControllerState"):
        raise TrajectoryError(
            f"{path}: {{0}}: only :reference of a JointTrajectoryControllerState is known.",
            Argument("topic", requested),
        )
    chosen_topic = name
    if not name:
        count_by_topic = {topic: topics[topic][1] for topic in readable_topics}
        chosen_topic = max(count_by_topic, key=count_by_topic.__getitem__)  # with most messages
    other_topics = [topic for topic in readable_topics if topic != chosen_topic]
    notes = []
    if other_topics and requested is None:
        option = spell(Argument("topic"))
        notes.append(
            f"Read from topic {chosen_topic}, which has most messages; {option} chooses another: {listed(other_topics)}."
        )
    return [chosen_topic, type_by_topic[chosen_topic], part, *notes]


def _nanoseconds(stamp: Any) -> int:
    """Nanoseconds of a stamp or duration of ROS 1 or 2."""
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * 10**9 + int(stamp.nanosec)
    return int(stamp.secs) * 10**9 + int(stamp.nsecs)


def _seconds(stamp: Any, begin: Any = None) -> float:
    """Seconds of a stamp or duration, since ``begin``."""
    nanoseconds = _nanoseconds(stamp)
    if begin is not None:
        nanoseconds -= _nanoseconds(begin)  # as integers: nanoseconds since 1970 exceed the precision of a float
    return nanoseconds / 1e9


def _stamps(messages: Sequence[Any], first: Any) -> Array:
    """Times (n,) of messages since the stamp of the message ``first`` [s]."""
    return np.array([_seconds(message.header.stamp, first.header.stamp) for message in messages])


def _joint_states(messages: Sequence[Any], where: str) -> tuple[list[str], Array]:
    """Header and table of the messages that have the joints of the first message; other messages are ignored."""
    names = list(messages[0].name)
    states = [message for message in messages if set(message.name) >= set(names)]
    header = ["time [s]"]
    columns = [_stamps(states, states[0])[:, None]]
    for field, quantity in (("position", "q"), ("velocity", "dq"), ("effort", "tau")):
        values = _values_of(states, field, names)
        if values is not None:
            columns.append(values)
            header += _headers(names, quantity)
    if len(columns) == 1:
        raise TrajectoryError(f"{where}: its messages have neither positions nor efforts for their joints.")
    return header, np.concatenate(columns, axis=1)


def _values_of(states: Sequence[Any], field: str, names: Sequence[str]) -> Array | None:
    """Values (n, k) of joint states in the order of the names; None unless each state has one for each of its joints."""
    rows = []
    for state in states:
        own_names = list(state.name)
        values = np.asarray(getattr(state, field), float)
        if len(values) != len(own_names):
            return None
        entries = [own_names.index(name) for name in names]
        rows.append(values[entries])
    return np.array(rows)


def _controller_states(messages: Sequence[Any], part: str, where: str) -> tuple[list[str], Array]:
    """Header and table of a controller's states: reference points if ``part``, else measured points with their commands."""
    reference_field, feedback_field = "desired", "actual"  # names in older versions of the message
    if hasattr(messages[0], "reference"):
        reference_field, feedback_field = "reference", "feedback"
    names = list(messages[0].joint_names)
    states = [message for message in messages if list(message.joint_names) == names]
    references = [getattr(state, reference_field) for state in states]
    if part:
        q, dq, ddq, _ = _values(references, len(names), where)
        arrays = {"q": q, "dq": dq, "ddq": ddq}
    else:
        measured_points = [getattr(state, feedback_field) for state in states]
        q, dq, _, effort = _values(measured_points, len(names), where)
        arrays = {"q": q, "dq": dq, "tau": effort, "command": _array_of(references, "positions", len(names))}
    header = ["time [s]"]
    columns = [_stamps(states, states[0])[:, None]]
    for quantity, array in arrays.items():
        if array is not None:
            header += _headers(names, quantity)
            columns.append(array)
    return header, np.concatenate(columns, axis=1)


def _with_commands(
    header: list[str], table: Array, messages: Sequence[Any], first: Any, where: str
) -> tuple[list[str], Array]:
    """Header and table with the latest command at each row; rows before the first command are left out.

    ``messages`` are the commands, and ``first`` is the first message of the positions, at time 0.
    """
    if not hasattr(first, "header") or not messages or not hasattr(messages[0], "position"):
        raise TrajectoryError(
            f"{where}: commands are read from joint states, beside a topic of joint states or of a controller's state. "
            "{0} must name such a topic.",
            Argument("command_topic"),
        )
    names = list(messages[0].name)
    time = _stamps(messages, first)
    are_alike = all(list(message.name) == names and len(message.position) == len(names) for message in messages)
    goes_back = (np.diff(time) < 0.0).any()
    if not are_alike or goes_back:
        raise TrajectoryError(
            f"{where}: each message needs a later stamp and one position for each of {listed(names)}. Record the topic of one "
            "controller."
        )
    latest = np.searchsorted(time, table[:, 0], side="right") - 1  # -1: no command yet
    has_command = latest >= 0
    if not has_command.any():
        raise TrajectoryError(f"{where}: its first stamp is after the last one of the positions, on another clock.")
    commanded_positions = np.array([message.position for message in messages], float)
    command_columns = commanded_positions[latest[has_command]]
    return [*header, *_headers(names, "command")], np.concatenate([table[has_command], command_columns], axis=1)


def _headers(names: Sequence[str], quantity: str) -> list[str]:
    """Names of the columns of one quantity: q, dq, ddq, tau or command."""
    return [f"{name}{SUFFIX[quantity]}" for name in names]


def _values(points: Sequence[Any], count: int, where: str) -> list[Any]:
    """Positions, velocities, accelerations and efforts (n, count) of points, each None unless all points have them.

    Raises TrajectoryError without positions.
    """
    fields = ("positions", "velocities", "accelerations", "effort")
    arrays = [_array_of(points, field, count) for field in fields]
    positions, *_ = arrays
    if positions is None:
        raise TrajectoryError(f"{where}: a point has not one position for each of the {count} joints that are named.")
    return arrays


def _array_of(points: Sequence[Any], field: str, count: int) -> Array | None:
    """One field of points, (n, count); None unless each point has all its values."""
    rows = [getattr(point, field) for point in points]
    lengths = {len(row) for row in rows}
    if lengths != {count}:
        return None
    return np.array(rows, float)


def _accelerations(points: Sequence[Any], count: int) -> tuple[Array, Array]:
    """Accelerations (n, count) of points, NaN where a point has none, and the mask (n,) of points that have them."""
    ddq = np.full((len(points), count), np.nan)
    has_acceleration = np.zeros(len(points), bool)
    for k, point in enumerate(points):
        if len(point.accelerations) == count:
            ddq[k] = point.accelerations
            has_acceleration[k] = True
    return ddq, has_acceleration


def _plan(messages: Sequence[Any], where: str) -> tuple[list[str], Array, str]:
    """Header and table of the longest plan, evaluated between its points, and a note on it."""
    plans = [_points(message) for message in messages]
    point_counts = [len(time) for _, _, time in plans]
    names, points, time = plans[int(np.argmax(point_counts))]  # the first of the longest plans
    if len(time) < 2:
        raise TrajectoryError(f"{where}: a plan of {len(time)} points. A motion needs two or more.")
    is_not_later = np.diff(time) <= 0  # of each point after the first
    if is_not_later.any():
        k = int(np.flatnonzero(is_not_later)[0])
        raise TrajectoryError(
            f"{where}: point {k + 2} at {number(time[k + 1])} s does not come after the one before, at {number(time[k])} s."
        )
    q, dq, _, _ = _values(points, len(names), where)
    ddq, has_acceleration = _accelerations(points, len(names))
    _check_finite("positions", q, where)
    if dq is not None:
        _check_finite("velocities", dq, where)
    _check_finite("accelerations", np.where(has_acceleration[:, None], ddq, 0.0), where)
    curve_text = "a cubic"
    if has_acceleration.all():
        curve_text = "a quintic"
    elif (has_acceleration[1:] & has_acceleration[:-1]).any():
        curve_text = "a quintic where both have accelerations, else a cubic"
    if dq is None:
        if len(time) < FEWEST:
            raise TrajectoryError(
                f"{where}: {len(time)} points without velocities are too few to derive them from. Give at least {FEWEST}, or "
                "velocities and accelerations at each point."
            )
        dq, ddq = spline_rates(time, q)
        curve_text = "a quintic spline, as its points have no velocities"
    step = max(STEP, (time[-1] - time[0]) / _MAX_ROWS)
    note = f"Plan of {len(time)} points: between them each joint follows {curve_text}, evaluated every {number(1e3 * step)} ms."
    if len(plans) > 1:
        note += f" The longest of {len(plans)} plans."
    header = ["time [s]"]
    for quantity in ("q", "dq", "ddq"):
        header += _headers(names, quantity)
    return header, between_points(time, q, dq, ddq, step), note


def _check_finite(name: str, x: Array, where: str) -> None:
    """Raise TrajectoryError for a point (row of x) with a number that is not finite; ``name`` is the quantity."""
    is_finite = np.isfinite(x).all(axis=1)
    if not is_finite.all():
        k = int(np.flatnonzero(~is_finite)[0])
        raise TrajectoryError(f"{where}: {name} of point {k + 1} are {x[k].tolist()}. They must be finite.")


def _points(message: Any) -> tuple[list[str], list[Any], Array]:
    """Joint names, points and times of a plan; the parts of a DisplayTrajectory are concatenated."""
    trajectories = getattr(message, "trajectory", [message])
    parts = [getattr(trajectory, "joint_trajectory", trajectory) for trajectory in trajectories]
    if not parts:
        return [], [], np.zeros(0)
    names = list(parts[0].joint_names)
    points = list[Any]()
    times = list[float]()
    begin = 0.0  # time at which a part begins: the end of the previous part
    for part in parts:
        if list(part.joint_names) != names:
            continue
        for k, point in enumerate(part.points):
            time = begin + _seconds(point.time_from_start)
            repeats_last_point = k == 0 and bool(times) and time == begin
            if not repeats_last_point:
                points.append(point)
                times.append(time)
        if times:
            begin = times[-1]
    return names, points, np.array(times)


def between_points(time: Array, q: Array, dq: Array, ddq: Array, step: float) -> Array:
    """Rows of time, q, dq, ddq at the points of a plan and every ``step`` between, as ros2_controllers execute it.

    Each segment is a quintic, or a cubic if the ddq of a point beside it is NaN.

    Parameters
    ----------
    time : (n,) array [s]
    q, dq, ddq : (n, k) arrays, at the points; entries of ddq may be NaN
    step : float [s]

    Returns
    -------
    rows : (m, 1 + 3 k) array

    Examples
    --------
    >>> import numpy as np
    >>> time, q = np.array([0.0, 1.0]), np.array([[0.0], [1.0]])
    >>> between_points(time, q, 0 * q, 0 * q, 0.5).round(3).tolist()
    [[0.0, 0.0, 0.0, 0.0], [0.5, 0.5, 1.875, 0.0], [1.0, 1.0, 0.0, 0.0]]
    """
    from scipy.interpolate import PPoly

    # s runs from 0 to 1 in each segment; velocities v0, v1 and accelerations a0, a1 are derivatives by it.
    h = np.diff(time)[:, None]
    displacement = np.diff(q, axis=0)
    v0 = h * dq[:-1]
    v1 = h * dq[1:]
    # The cubic is q_k + v0 s + b s² + c s³. With its accelerations at both ends, the quintic is equal to it.
    b = 3 * displacement - 2 * v0 - v1
    c = v0 + v1 - 2 * displacement
    is_quintic = np.isfinite(ddq[:-1] + ddq[1:])
    a0 = np.where(is_quintic, h * h * ddq[:-1], 2 * b)
    a1 = np.where(is_quintic, h * h * ddq[1:], 2 * b + 6 * c)
    # Displacement, velocity and acceleration at the end, beyond those of q_k + v0 s + a0 s² / 2.
    e0 = displacement - v0 - 0.5 * a0
    e1 = v1 - v0 - a0
    e2 = a1 - a0
    coefficients = np.array(  # of 1, s, s² … s⁵
        [q[:-1], v0, 0.5 * a0, 10 * e0 - 4 * e1 + 0.5 * e2, -15 * e0 + 7 * e1 - e2, 6 * e0 - 3 * e1 + 0.5 * e2]
    )
    for k, coefficient in enumerate(coefficients):
        coefficient /= h**k  # from powers of s to powers of time
    curve = PPoly(coefficients[::-1], time)
    grid = np.arange(time[0], time[-1], step)
    next_point = np.searchsorted(time, grid)
    time_after = time[np.clip(next_point, 1, len(time) - 1)]
    time_before = time[np.clip(next_point - 1, 0, None)]
    is_close = np.abs(time_after - grid) < _MIN_GAP_OF_STEP * step  # to a point, which has a row of its own
    is_close |= np.abs(time_before - grid) < _MIN_GAP_OF_STEP * step
    t = np.sort(np.r_[time, grid[~is_close]])
    return np.concatenate([t[:, None], curve(t), curve.derivative(1)(t), curve.derivative(2)(t)], axis=1)


_MESSAGE_TYPES = (
    "JointState",
    "JointTrajectory",
    "RobotTrajectory",
    "DisplayTrajectory",
    "JointTrajectoryControllerState",
)
"""Supported message types."""


def _mcap(path: Path, choose: Callable[[Topics], str]) -> Iterator[Any]:
    """Messages of an MCAP file in the topic that ``choose`` returns."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise MissingExtraError.from_extra("mcap", "logs", "Reading MCAP") from None
    topics: dict[str, tuple[str, int]] = {}

    def count_messages(channel: Any, schema: Any, count: int) -> None:
        message_type = "" if schema is None else str(schema.name)
        _, count_before = topics.get(channel.topic, ("", 0))
        topics[channel.topic] = message_type, count_before + count

    check_chunks(path)
    with BoundedFile(path) as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        if summary is not None and summary.statistics is not None:
            counts = summary.statistics.channel_message_counts
            for channel_id, channel in summary.channels.items():
                schema = summary.schemas[channel.schema_id] if channel.schema_id else None
                count_messages(channel, schema, counts.get(channel_id, 0))
        else:
            for schema, channel, _ in reader.iter_messages():
                count_messages(channel, schema, 1)
        for *_, message in reader.iter_decoded_messages(topics=[choose(topics)]):
            yield message


def _typestore() -> Any:
    """Message definitions of ROS 2 Humble; raises MissingExtraError."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError.from_extra("rosbags", "logs", "Reading bags of ROS") from None
    return get_typestore(Stores.ROS2_HUMBLE)


def _with_definition(store: Any, message_type: str, text: str) -> Any:
    """The store, with the definition of one more type."""
    from rosbags.typesys import get_types_from_msg

    store.register(get_types_from_msg(text, message_type))
    return store


def _bag(path: Path, choose: Callable[[Topics], str]) -> Iterator[Any]:
    """Messages of a ROS 1 bag or a rosbag2 folder in the topic that ``choose`` returns."""
    store = _typestore()
    from rosbags.highlevel import AnyReader

    for message_type, (newest_text, *_) in _DEFINITIONS.items():
        store = _with_definition(store, message_type, newest_text)
    if path.is_dir():
        check_folder(path)
    with AnyReader([path], default_typestore=store) as reader:
        topics = {name: (topic.msgtype or "", topic.msgcount) for name, topic in reader.topics.items()}
        connections = reader.topics[choose(topics)].connections
        for connection, _, raw in reader.messages(connections=connections):
            yield reader.deserialize(raw, connection.msgtype)


def _database(path: Path, choose: Callable[[Topics], str]) -> Iterator[Any]:
    """Messages of a rosbag2 database without its metadata.yaml."""
    store = _typestore()
    with recording_database(path) as database:
        count_query = (
            "select name, type, count(messages.id) from topics left join messages on topics.id = topic_id group by name"
        )
        topics: dict[str, tuple[str, int]] = {}
        for name, type_of_topic, count in database.execute(count_query):
            topics[str(name)] = str(type_of_topic), int(count)
        topic = choose(topics)
        message_type, _ = topics[topic]
        has_definitions_query = "select 1 from sqlite_master where name = 'message_definitions'"
        texts: Sequence[str] = _DEFINITIONS.get(message_type, ())
        if database.execute(has_definitions_query).fetchone():
            text_query = "select encoded_message_definition from message_definitions"
            text_query += " where topic_type = ? and encoding = 'ros2msg'"
            own_texts = [str(text) for (text,) in database.execute(text_query, (message_type,))]
            texts = own_texts or texts
        data_query = "select data from messages join topics on topics.id = topic_id where name = ? order by timestamp"
        data = values_within((raw for (raw,) in database.execute(data_query, (topic,))), path)
    yield from _deserialise(store, message_type, texts, data)


def _deserialise(store: Any, message_type: str, texts: Sequence[str], data: Sequence[bytes]) -> list[Any]:
    """Deserialise messages by the first definition that matches; without definitions, by the store's own."""
    from rosbags.serde import SerdeError

    for text in texts[:-1]:
        try:
            own_store = _with_definition(_typestore(), message_type, text)
            return [own_store.deserialize_cdr(raw, message_type) for raw in data]
        except (SerdeError, struct.error):  # the second of versions before 0.11, for messages that end early
            continue
    if texts:
        store = _with_definition(store, message_type, texts[-1])
    return [store.deserialize_cdr(raw, message_type) for raw in data]
