"""franka-sim on an address of this machine, with both of its enforcements; runs in .judges/franka.

Its arm is the FR3 of aiofranka, as its own is downloaded when it starts. It says when it is ready,
and whether it has real-time priority.
"""

import gc
import os
import sys
from importlib.util import find_spec
from pathlib import Path

from scenarios.judges.real_time import own_core, real_time

CORE, PRIORITY = 0, 50


def main(host: str) -> None:
    package = find_spec("aiofranka")
    if package is None or package.origin is None:
        sys.exit("aiofranka is not installed: make judges")
    os.environ["FR3_MJCF"] = str(Path(package.origin).parent / "model" / "fr3.xml")
    from franka_sim.franka_sim_server import FrankaSimServer  # reads the environment

    class Server(FrankaSimServer):  # type: ignore[misc]
        def run_server(self) -> None:
            priority = "real-time" if permitted else "usual"
            print(f"franka-sim at {self.host}, {priority} priority", flush=True)
            super().run_server()

    server = Server(host=host, enforce_comm_constraints=True, enforce_motion_limits=True)
    permitted = own_core(CORE) and real_time(PRIORITY)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        server.start()
    finally:
        server.stop()


if __name__ == "__main__":
    main(sys.argv[1])
