"""Results to tables, pictures and files."""

from texclass.reporting.feature_report import feature_card, write_feature_report
from texclass.reporting.inspection import draw_inspection
from texclass.reporting.listings import dataset_table, feature_table
from texclass.reporting.peers import peer_table, write_peer_report
from texclass.reporting.report import write_report
from texclass.reporting.tables import benchmark_table

__all__ = [
    "benchmark_table",
    "dataset_table",
    "draw_inspection",
    "feature_card",
    "feature_table",
    "peer_table",
    "write_feature_report",
    "write_peer_report",
    "write_report",
]
