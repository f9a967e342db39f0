"""Classical manipulation for MuJoCo: QP inverse kinematics, time-optimal motion, impedance control."""

__version__ = "0.1.0"
