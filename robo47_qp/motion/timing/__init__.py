"""Time along a motion: jerk-limited, inside the limits of the joints."""
