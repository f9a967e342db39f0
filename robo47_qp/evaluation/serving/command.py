"""A policy served to benchmarks: answers observations with actions over a websocket."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from rich.console import Console
from rich.markup import escape

from robo47_qp.arrays import CheckedOptions, Count, Positive, Range
from robo47_qp.cli import OK, main
from robo47_qp.evaluation.serving.server import PolicyServer
from robo47_qp.run.foreign_code import load_class


@dataclass(frozen=True, kw_only=True)
class ServeOptions(CheckedOptions):
    """Options of a policy server."""

    policy: str
    """module:Class or file.py:Class of what answers: a class with infer(observation), made anew
    for each connection; both observation and answer are maps of names to numbers and arrays."""
    host: str = PolicyServer.host
    """Address to listen at; 0.0.0.0 is reached from other machines."""
    port: Annotated[int, Range(at_least=0, at_most=65535, whole=True)] = PolicyServer.port
    """Port to listen at; 0 takes one that is free."""
    clients: Count = PolicyServer.clients
    """Connections at once."""
    longest: Count = PolicyServer.longest
    """Longest message that is read [B]."""
    patience: Positive = PolicyServer.patience
    """Time in which a client must take in its answer [s]."""


def serve_command(args: Sequence[str] | None = None, prog: str | None = None) -> int:
    """Serve from the command line, and return the exit code; see `robo47_qp.cli.main`."""
    return main(ServeOptions, serve_chosen, __doc__, args=args, prog=prog)


def serve_chosen(options: ServeOptions, console: Console) -> int:
    """Serve the policy that was chosen until SIGINT or SIGTERM, and return the exit code."""
    made = load_class("policy", options.policy, ["infer"])

    def tell(words: str) -> None:
        console.print(escape(words), highlight=False, soft_wrap=True)

    PolicyServer(
        make=made,
        host=options.host,
        port=options.port,
        clients=options.clients,
        longest=options.longest,
        patience=options.patience,
        told=tell,
    ).run(lambda at: tell(f"{options.policy} is served at {at}; Ctrl-C ends it"))
    tell("ended")
    return OK
