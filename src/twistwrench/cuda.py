"""Robots' quantities on a GPU: what :mod:`twistwrench.robot.cuda_robot` has."""

from .kernels.device_array import DeviceArray, to_device
from .robot.cuda_robot import CudaRobot

__all__ = ["CudaRobot", "DeviceArray", "to_device"]
