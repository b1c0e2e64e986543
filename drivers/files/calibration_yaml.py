"""YAML of calibration files, as ROS, OpenCV and Kalibr write it: bounded, without anchors and without types."""

from pathlib import Path
from typing import Any

import yaml

from drivers.errors import DriverError

LARGEST_BYTES = 1_000_000
DEEPEST = 20
"""Levels of nesting; a calibration has three."""

OPENCV_HEAD = "%YAML:1.0"
"""OpenCV's first line, which is no directive of YAML."""


def parse(path: Path) -> dict[str, Any]:
    """The mapping in the first document of a file; DriverError, one line, for anything else."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise DriverError(
            f"{path}: the camera's calibration cannot be read ({error.strerror}); "
            "calibrate with 'landslope calibrate', or set camera.calibration to the right file"
        ) from None
    if len(data) > LARGEST_BYTES:
        raise DriverError(
            f"{path}: larger than {LARGEST_BYTES // 1_000_000} MB, so no calibration of a camera"
        )
    try:
        text = data.decode("utf-8-sig").removeprefix(OPENCV_HEAD)
        content = next((part for part in yaml.load_all(text, _Loader) if part is not None), None)
    except (yaml.YAMLError, UnicodeDecodeError, ValueError) as error:
        where = " ".join(str(error).split())
        raise DriverError(
            f"{path}: not a YAML file as ROS, OpenCV or Kalibr write calibrations ({where[:160]}); correct it there"
        ) from None
    if not isinstance(content, dict):
        raise DriverError(f"{path}: no camera_info in it: a mapping with image_width, camera_matrix, ...")
    return content


class _Loader(yaml.SafeLoader):
    """Every scalar as text or a number, tags ignored, aliases and deep nesting refused."""

    _depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):  # a few lines of them can stand for gigabytes
            raise yaml.YAMLError("it uses anchors and aliases, which no calibration needs")
        self._depth += 1
        if self._depth > DEEPEST:
            raise yaml.YAMLError(f"nested deeper than {DEEPEST} levels")
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1


def _untagged(loader: _Loader, _suffix: str, node: yaml.Node) -> Any:
    """What stands under a tag of another tool, as OpenCV's !!opencv-matrix."""
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return node.value


_Loader.add_multi_constructor("", _untagged)
# a date is text: a wrong one is not this file's business
yaml.add_constructor("tag:yaml.org,2002:timestamp", lambda _, node: node.value, _Loader)
