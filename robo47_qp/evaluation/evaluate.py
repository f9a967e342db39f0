"""An evaluation from its options to its files."""

import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from robo47_qp.command import BAD_INPUT, FAILED, INTERRUPTED, OK
from robo47_qp.errors import InvalidValueError
from robo47_qp.evaluation.episode import EpisodeResult, EpisodeSpec
from robo47_qp.evaluation.evaluation import Evaluation, code_digest
from robo47_qp.evaluation.executor import Executor, LocalProcesses
from robo47_qp.evaluation.failures import is_same, picked, record_failures
from robo47_qp.evaluation.journal import Journal, JournalError
from robo47_qp.evaluation.options import EvaluateOptions, policy_settings
from robo47_qp.evaluation.plots import plot_evaluation
from robo47_qp.evaluation.policy import CLASSICAL, PolicyReference
from robo47_qp.evaluation.progress import EvaluationBar
from robo47_qp.evaluation.ray_cluster import RayCluster
from robo47_qp.evaluation.summary import compared, summary, throughput
from robo47_qp.evaluation.task_episode import Drive, TaskEpisode, classical
from robo47_qp.evaluation.words import comparison_line, markdown, rate_line, throughput_line
from robo47_qp.files import claim, write_text
from robo47_qp.json_file import read_json
from robo47_qp.report import plain, versions
from robo47_qp.robot import Robot
from robo47_qp.task import Task
