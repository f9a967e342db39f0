"""Policies that cheat, or harm themselves; run in processes of their own."""

import contextlib
import functools
import gc
import inspect
import json
import logging
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import namedtuple
from pathlib import Path
from typing import Any

import numpy as np

from robo47_qp import JointTarget, Observation

print("printed at import")


class Still:
    """Stays where it is."""

    episodes = 0

    def reset(self, observation: Observation) -> None:
        Still.episodes += 1
        self.q = observation.q
        self.first = [Still.episodes, random.random(), float(np.random.random())]  # noqa: NPY002

    def act(self, observation: Observation) -> Any:
        return JointTarget(q=self.q)


class Remembers(Still):
    """Says by the width how many episodes its class has seen, and what it has drawn."""

    def act(self, observation: Observation) -> Any:
        raise ValueError(self.first)


class Collector(Still):
    """Looks for the world among all objects."""

    def act(self, observation: Observation) -> Any:
        # Every process of a policy imports this module, and one looks for a world.
        from robo47_qp.sim import simulation

        worlds = [one for one in gc.get_objects() if isinstance(one, simulation.Simulation)]
        for world in worlds:
            world.place_object("cube", world.marker_pose("goal"))
        return JointTarget(q=self.q)


class Referrer(Still):
    """Looks for who holds the observation."""

    def act(self, observation: Observation) -> Any:
        gc.get_referrers(observation)
        return JointTarget(q=self.q)


class Climber(Still):
    """Looks for the world in the frames of its callers."""

    @staticmethod
    def here() -> Any:
        return sys._getframe()

    def act(self, observation: Observation) -> Any:
        frame = self.here()
        while frame is not None:
            for one in frame.f_locals.values():
                if hasattr(one, "place_object"):
                    one.place_object("cube", one.marker_pose("goal"))
            frame = frame.f_back
        return JointTarget(q=self.q)


class Inspector(Climber):
    """The same through the module that has it for debuggers."""

    @staticmethod
    def here() -> Any:
        return inspect.currentframe()


class Watcher(Climber):
    """The same through the frames of all threads."""

    @staticmethod
    def here() -> Any:
        return sys._current_frames()[threading.get_ident()]


class Stumbler(Climber):
    """The same through an error of its own."""

    @staticmethod
    def here() -> Any:
        try:
            raise ValueError
        except ValueError as error:
            return error.__traceback__.tb_frame if error.__traceback__ else None


class Tracer(Still):
    """Follows what is called."""

    def act(self, observation: Observation) -> Any:
        sys.setprofile(lambda *_: None)
        sys.setprofile(None)
        return JointTarget(q=self.q)


class Quoter(Still):
    """Has text executed that looks at what an object holds, and who else does."""

    def act(self, observation: Observation) -> Any:
        exec("import gc; gc.get_referents(self)")
        eval("gc.get_referrers(self)", {"gc": gc, "self": self})
        return JointTarget(q=self.q)


class Prophet(Still):
    """Builds the world of an evaluation's episode from its seed, and looks where the goal is."""

    def act(self, observation: Observation) -> Any:
        from robo47_qp.evaluation.perturbation import PRESETS
        from robo47_qp.evaluation.task_episode import TaskEpisode
        from robo47_qp.model.robots import load_robot
        from robo47_qp.run.registry import load_task

        task, perturbation = load_task("pick_place")(), PRESETS["moderate"]
        episode = TaskEpisode(robot=load_robot("panda"), task=task, perturbation=perturbation)
        episode.simulation(episode.scenario(0), 0, drawn=False)
        return JointTarget(q=self.q)


class Logger(Still):
    """Uses libraries that look at frames and objects for their own purposes."""

    def act(self, observation: Observation) -> Any:
        logging.getLogger("policy").error("here")
        warnings.warn("here", stacklevel=2)
        if namedtuple("Pair", "a b").__module__ != __name__:
            raise ValueError("the frame is another one")
        gc.collect()
        try:
            raise ValueError
        except ValueError:
            logging.getLogger("policy").exception("there: %s", traceback.format_exc())
        return JointTarget(q=self.q)


class Patcher(Still):
    """Makes every verdict of its own process a success."""

    def reset(self, observation: Observation) -> None:
        super().reset(observation)
        from robo47_qp.run.watchdog import Watchdog
        from robo47_qp.tasks.pick_place.pick_place import PickPlace

        for kind, name in ((PickPlace, "verdict"), (Watchdog, "check")):
            setattr(kind, name, lambda *_, **__: None)


class LatePatcher(Patcher):
    """Does so in its last answers."""

    def reset(self, observation: Observation) -> None:
        Still.reset(self, observation)

    def act(self, observation: Observation) -> Any:
        if observation.time > 0.15:
            Patcher.reset(self, observation)
        return JointTarget(q=self.q)


class Rewriter(Still):
    """Keeps the verdict with other code in it, and what it goes by with other numbers."""

    def act(self, observation: Observation) -> Any:
        from robo47_qp.run.watchdog import Watchdog
        from robo47_qp.tasks.handling import place_criterion
        from robo47_qp.tasks.pick_place.pick_place import PickPlace

        PickPlace.verdict.__code__ = (lambda _, __: None).__code__
        options = place_criterion.PlaceCriterion.__init__.__kwdefaults__ or {}
        options.update(tilt=10.0)
        place_criterion._HOME = 1e9
        Watchdog.time_limit = 1e9
        return JointTarget(q=self.q)


class Remaker(Still):
    """Replaces a property, and searches again and again."""

    def act(self, observation: Observation) -> Any:
        from robo47_qp.run.foreign_code import Guard

        Guard.words = functools.partial(print)  # type: ignore[assignment]
        gc.get_objects()
        return JointTarget(q=self.q)


class Forker(Still):
    """Goes on twice."""

    def act(self, observation: Observation) -> Any:
        if observation.time == 0.0:
            # Both answer at about the same time.
            ready, alive = os.pipe()
            if os.fork():
                os.read(ready, 1)
            else:
                os.write(alive, b"x")
        return JointTarget(q=self.q)


class Forger(Still):
    """Writes a result of its own to everything that it has open."""

    def act(self, observation: Observation) -> Any:
        text = b'{"index": 0, "seed": 0, "success": true}\n'
        for fd in range(256):
            with contextlib.suppress(OSError):
                os.write(fd, text)
        return JointTarget(q=self.q)


class Leaver(Still):
    def act(self, observation: Observation) -> Any:
        os._exit(0)


class Quitter(Still):
    def act(self, observation: Observation) -> Any:
        sys.exit("enough")


class Wordy(Still):
    def act(self, observation: Observation) -> Any:
        raise ValueError("\ud800\r# heading " + f"{self!r}" + "x" * 50_000_000)


class Mangler(Still):
    """Sends a field whose name is no text that can be written."""

    def act(self, observation: Observation) -> Any:
        from robo47_qp.run.policy import wire

        wire.packed_action = lambda _: {"kind": "q", "q": [0.0] * 7, "\ud800\r# won\u2028": 1}  # type: ignore[assignment]
        return None


class Big(Still):
    def act(self, observation: Observation) -> Any:
        return JointTarget(q=np.zeros(1_000_000))


class Parent(Still):
    """Starts a process that would stay, in a session of its own, and leaves files."""

    def act(self, observation: Observation) -> Any:
        folder = tempfile.mkdtemp()
        child = subprocess.Popen(
            ["sleep", "600"], start_new_session=True, env={}, stdout=subprocess.DEVNULL
        )
        raise ValueError(f"{child.pid} {folder}")


class Orphan(Still):
    """Kills what watches it, after it has started a process that would stay."""

    def act(self, observation: Observation) -> Any:
        command = [sys.executable, "-c", "import time; time.sleep(600)", tempfile.gettempdir()]
        subprocess.Popen(command, start_new_session=True, env={}, stdout=subprocess.DEVNULL)
        os.kill(os.getppid(), signal.SIGKILL)
        return JointTarget(q=self.q)


class Digger(Still):
    """Leaves folders within each other, deeper than Python calls itself."""

    def act(self, observation: Observation) -> Any:
        here = Path.cwd()
        os.chdir(tempfile.gettempdir())
        for _ in range(1500):
            os.mkdir("d")  # noqa: PTH102  # the whole path is too long
            os.chdir("d")
        os.chdir(here)
        raise ValueError(tempfile.gettempdir())


class Heir(Still):
    """Leaves a process that has killed what watches it and keeps the line."""

    def act(self, observation: Observation) -> Any:
        warden = os.getppid()
        if os.fork() == 0:
            os.setsid()
            os.kill(warden, signal.SIGKILL)
            time.sleep(30.0)
            os._exit(0)
        time.sleep(1000.0)


class Stopper(Still):
    """Stops what watches it."""

    def act(self, observation: Observation) -> Any:
        os.kill(os.getppid(), signal.SIGSTOP)
        raise ValueError(f"{os.getpid()} {tempfile.gettempdir()}")


class Holder(Still):
    """Stops what watches it, after it has started a process that would stay, and hangs."""

    def act(self, observation: Observation) -> Any:
        command = [sys.executable, "-c", "import time; time.sleep(601)"]
        subprocess.Popen(command, start_new_session=True, env={}, stdout=subprocess.DEVNULL)
        os.kill(os.getppid(), signal.SIGSTOP)
        time.sleep(1000.0)


class Sleeper(Still):
    def act(self, observation: Observation) -> Any:
        time.sleep(1000.0)


class Dripper(Still):
    """Sends an answer byte by byte, for 10 s."""

    def act(self, observation: Observation) -> Any:
        line = socket.socket(fileno=json.loads(sys.argv[1])["line"])
        line.sendall(struct.pack("<I", 200))
        for _ in range(200):
            line.sendall(b" ")
            time.sleep(0.05)


class Wrong(Still):
    def act(self, observation: Observation) -> Any:
        return Path()


class Pusher(Still):
    """Commands torques straight away from what holds it, as hard as the motors allow."""

    def act(self, observation: Observation) -> Any:
        from robo47_qp.run.policy.policy import Torques

        return Torques(tau=np.array([87.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
