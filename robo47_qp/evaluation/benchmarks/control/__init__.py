"""Controllers compared: the same motion under the same disturbances."""
