"""Robots' quantities on a GPU: what :mod:`twistwrench.robot.cuda_robot` has."""

from .robot.cuda_robot import CudaRobot, DeviceArray, to_device

__all__ = ["CudaRobot", "DeviceArray", "to_device"]
