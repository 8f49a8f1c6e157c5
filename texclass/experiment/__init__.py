"""Experiments: a pipeline TOML evaluated on a dataset."""

from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.definition import PipelineDefinition, load_pipeline
from texclass.experiment.evaluate import Evaluation, evaluate
from texclass.experiment.extraction import cached_table, extract_table
from texclass.experiment.protocols import PROTOCOLS, Protocol, find_protocol
from texclass.experiment.result import Accuracy, BenchmarkResult, Confusion, RowResult, wilson_interval
from texclass.experiment.selection import ForwardSelector
from texclass.experiment.table import FeatureTable, read_table

__all__ = [
    "PROTOCOLS",
    "Accuracy",
    "BenchmarkResult",
    "Confusion",
    "Evaluation",
    "FeatureTable",
    "ForwardSelector",
    "PipelineDefinition",
    "Protocol",
    "RowResult",
    "cached_table",
    "evaluate",
    "extract_table",
    "find_protocol",
    "load_pipeline",
    "read_table",
    "run_benchmark",
    "wilson_interval",
]
