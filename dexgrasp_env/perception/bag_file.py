"""Clouds in ROS bags: `sensor_msgs/PointCloud2` of a topic, without ROS.

A bag is a `.bag` of ROS 1, or the folder of ROS 2 (`metadata.yaml` beside `.db3` or `.mcap`).
"""

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dexgrasp_env.errors import InputError, unknown_name
from dexgrasp_env.extras import from_extra
from dexgrasp_env.perception.cloud import check_count

BAGS = (".bag", ".db3", ".mcap")
"""Endings of bags, and of the files in the folders of ROS 2."""
_KIND = "sensor_msgs/msg/PointCloud2"


def bag_of(path: Path) -> Path | None:
    """Return the bag that a path means: itself, or the folder that it lies in; None for another kind of path."""
    for one in (path, path.parent):
        if (one / "metadata.yaml").is_file() and (one == path or path.suffix.lower() in BAGS[1:]):
            return one
    return path if path.suffix.lower() in BAGS else None


def read_bag(path: Path, topic: str = "", *, posed: bool = False) -> NDArray[Any]:
    """Return the last cloud (N, 3) of a topic, m.

    Args:
        path: of the bag, see `bag_of`.
        topic: needed where several have clouds.
        posed: the pose of the cloud's frame is known; otherwise frames of cameras are refused.

    Raises:
        InputError: for a topic that is not there or is not said, a bag without clouds, and a frame without its pose.
        Exception: whatever else a damaged bag makes the parser trip over.
    """
    with from_extra():
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as bag:
        found = {one.topic: one for one in bag.connections if one.msgtype == _KIND and one.msgcount}
        if not found:
            raise InputError(f"{path} holds no {_KIND}: record the topic of a cloud")
        if topic and topic not in found:
            raise unknown_name(f"topic of clouds in {path}", topic, found)
        if len(found) > 1 and not topic:
            raise InputError(f"which topic of {path}? name it as {path}#TOPIC: valid are {', '.join(found)}")
        chosen = found[topic or next(iter(found))]
        (last,) = deque(bag.messages([chosen]), maxlen=1)
        message: Any = bag.deserialize(last[2], chosen.msgtype)
    frame = message.header.frame_id
    if frame.endswith(("optical_frame", "optical")) and not posed:
        raise InputError(
            f"{path}: the cloud is in frame {frame!r} of a camera: give the pose of that frame by --camera-pose"
        )
    return _rows(message, str(path))


def _rows(message: Any, path: str) -> NDArray[Any]:
    """Return x, y, z (N, 3) of a message; rows of an organised cloud may be padded."""
    order, fields = "<>"[bool(message.is_bigendian)], {field.name: field for field in message.fields}
    if not {*"xyz"} <= fields.keys():
        raise InputError(f"{path} has fields {', '.join(fields)}: x, y and z are needed")
    axes, numbers = [fields[axis] for axis in "xyz"], ("i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8")
    row = np.dtype(
        {
            "names": [*"xyz"],
            "formats": [order + numbers[field.datatype - 1] for field in axes],
            "offsets": [field.offset for field in axes],
            "itemsize": message.point_step,
        }
    )
    width, height = int(message.width), int(message.height)
    check_count(width * height, path)
    lines = np.frombuffer(bytes(message.data), np.uint8).reshape(height, message.row_step)
    held = np.ascontiguousarray(lines[:, : width * message.point_step]).ravel().view(row)
    return np.stack([held[axis] for axis in "xyz"], axis=1).astype(float)
