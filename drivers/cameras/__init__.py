"""Cameras behind one interface: V4L2, network streams, Raspberry Pi cameras, recordings at their pace."""

from drivers.cameras.choose import open_camera
from drivers.cameras.interface import Camera, CameraFormat, CameraStatus, Grab, Grabber, ReaderLimits

__all__ = ["Camera", "CameraFormat", "CameraStatus", "Grab", "Grabber", "ReaderLimits", "open_camera"]
