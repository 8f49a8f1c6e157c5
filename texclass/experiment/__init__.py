"""Experiments: a pipeline TOML evaluated on a dataset."""

from texclass.experiment.accuracy import Accuracy, cluster_interval, wilson_interval
from texclass.experiment.benchmark import run_benchmark
from texclass.experiment.feature_table import FeatureTable, cached_table, extract_table, read_table
from texclass.experiment.folds import Evaluation, evaluate
from texclass.experiment.new_feature import FeatureStudy, study_feature
from texclass.experiment.pipeline import PipelineDefinition, load_pipeline
from texclass.experiment.protocols import PROTOCOLS, Protocol, find_protocol, repeated
from texclass.experiment.result import BenchmarkResult, Confusion, RowResult
from texclass.experiment.selection import ForwardSelector
from texclass.experiment.windows import Window, touches
from texclass.experiment.workers import each, running_on

__all__ = [
    "PROTOCOLS",
    "Accuracy",
    "BenchmarkResult",
    "Confusion",
    "Evaluation",
    "FeatureStudy",
    "FeatureTable",
    "ForwardSelector",
    "PipelineDefinition",
    "Protocol",
    "RowResult",
    "Window",
    "cached_table",
    "cluster_interval",
    "each",
    "evaluate",
    "extract_table",
    "find_protocol",
    "load_pipeline",
    "read_table",
    "repeated",
    "run_benchmark",
    "running_on",
    "study_feature",
    "touches",
    "wilson_interval",
]
