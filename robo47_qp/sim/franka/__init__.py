"""The Franka robots by the protocol of libfranka: as what drives them, and as what answers."""
