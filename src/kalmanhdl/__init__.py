"""kalmanhdl: a Kalman filter, written once as a model, becomes verified FPGA hardware."""

__version__ = "0.1.0"
