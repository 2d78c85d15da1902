"""Devices as data: what a part holds, and how long its logic takes as the tools measured it."""

from kalmanhdl.target.device import DERATED, OPERANDS, Device
from kalmanhdl.target.library import device, device_names

__all__ = ["DERATED", "OPERANDS", "Device", "device", "device_names"]
