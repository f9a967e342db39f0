"""Types of MuJoCo 4.0, made with pybind11-stubgen and shortened by hand."""

from typing import Any

MJTNUM_BYTES: int
mjDISABLESTRING: tuple[Any, ...]
mjENABLESTRING: tuple[Any, ...]
mjFRAMESTRING: tuple[Any, ...]
mjLABELSTRING: tuple[Any, ...]
mjMAXCONPAIR: int
mjMAXFLEXNODES: int
mjMAXIMP: float
mjMAXLIGHT: int
mjMAXLINE: int
mjMAXLINEPNT: int
mjMAXOVERLAY: int
mjMAXPLANEGRID: int
mjMAXTREEDEPTH: int
mjMAXVAL: float
mjMINAWAKE: int
mjMINIMP: float
mjMINMU: float
mjMINVAL: float
mjNBIAS: int
mjNDYN: int
mjNEQDATA: int
mjNFLUID: int
mjNGAIN: int
mjNGROUP: int
mjNIMP: int
mjNISLAND: int
mjNPOLY: int
mjNREF: int
mjNSENS: int
mjNSOLVER: int
mjPI: float
mjRNDSTRING: tuple[Any, ...]
mjSC_IN: int
mjSC_INOUT: int
mjSC_OUT: int
mjTIMERSTRING: tuple[Any, ...]
mjVERSION_HEADER: int
mjVISSTRING: tuple[Any, ...]
