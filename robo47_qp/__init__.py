"""Classical manipulation for MuJoCo: QP inverse kinematics, Ruckig motion, impedance control."""

__version__ = "0.1.0"
